// SPDX-License-Identifier: Apache-2.0
// This file contains the kernels that build the tile lists on CPUs. Work-groups have one work-item, which processes a
// chunk of consecutive elements. The splats are sorted by depth with a radix sort, starting with the least significant
// digit; its first pass is combined with counting. Then one stable counting sort orders the intersections by tile. It
// visits the rectangles of the depth-ordered splats twice, first to count and then to place the intersections, so that
// no list of unsorted intersections is ever written. Histograms have the shape (chunk, bin), so that the row of a chunk
// stays in the cache of its core. The elements that are sorted by depth are words of 64 bits with the depth key in the
// upper half and the index of the splat in the lower half, so that each bin needs only one open cache line.
#define UBS_CHUNK_KERNEL __kernel __attribute__((reqd_work_group_size(1, 1, 1)))

// Number of scattered words that are written in one batch. For each batch, all places are computed and prefetched
// first, and then the words are written. Otherwise stores would wait for their cache lines one after the other, because
// in each iteration of training, other data displace the lists from the caches. With batches, the time of count_write
// for 300 000 splats falls from 0.65 to 0.36 ms, and that of tile_scatter from 1.78 to 1.15 ms.
#ifndef UBS_PLACES_BATCH
#define UBS_PLACES_BATCH 512
#endif

// Computes for each chunk the number of visible splats, the number of their tiles, and the smallest and largest depth
// key of the visible splats. Also computes the histogram of the first digit, which has `bits` bits. This is done in a
// separate loop, so that the other loop is vectorised. For 300 000 splats, this takes 0.11 ms instead of 0.17 ms.
UBS_CHUNK_KERNEL void count_sums(__global const uint* restrict tile_counts,
                                 __global const uint* restrict depth_keys, uint count, uint chunk, uint bits,
                                 __global ulong4* restrict sums,
                                 __global uint* restrict histogram UBS_CORE_PARAMETERS) {
  const size_t c = UBS_CORE_GROUP, begin = c * chunk, end = min(begin + chunk, (size_t)count);
  const uint mask = (1u << bits) - 1;
  __global uint* restrict bins = histogram + (c << bits);
  for (uint b = 0; b <= mask; b++) bins[b] = 0;
  uint drawn = 0, least = UINT_MAX, largest = 0;
  ulong tiles = 0;
  for (size_t i = begin; i < end; i++) {
    const uint key = depth_keys[i], here = tile_counts[i];
    const bool sorted = here > 0;
    drawn += here > 0 ? 1 : 0;
    tiles += here;
    least = min(least, sorted ? key : UINT_MAX);
    largest = max(largest, sorted ? key : 0);
  }
  for (size_t i = begin; i < end; i++) bins[depth_keys[i] & mask] += tile_counts[i] > 0 ? 1 : 0;
  sums[c] = (ulong4)(drawn, tiles, least, largest);
}

// Writes the slot offsets, and makes the first pass of the sort. `histogram` is the result of column_scan, and `starts`
// contains the first place of each bin. `totals` receives the numbers of visible splats and of intersections; it may be
// null. Splats that are not visible are written as well, because a branch would not be predictable. They are written
// after all visible splats, to one cache line per chunk, which is not read.
UBS_CHUNK_KERNEL void count_write(__global const uint* restrict tile_counts,
                                  __global const uint* restrict depth_keys, uint count, uint chunk, uint bits,
                                  __global const ulong4* restrict sums, __global uint* restrict histogram,
                                  __global const uint* restrict starts, __global uint* restrict slot_offsets,
                                  __global ulong* restrict pairs,
                                  __global ulong* restrict totals UBS_CORE_PARAMETERS) {
  const size_t c = UBS_CORE_GROUP, chunks = get_global_size(0);
  const size_t begin = c * chunk, end = min(begin + chunk, (size_t)count);
  const uint mask = (1u << bits) - 1, nowhere = ((count + 7) & ~7u) + 8 * (uint)c;
  __global uint* restrict places = histogram + (c << bits);
  for (uint b = 0; b <= mask; b++) places[b] += starts[b];
  uint slot = 0;
  for (size_t k = 0; k < c; k++) slot += (uint)sums[k].y;
  uint to[UBS_PLACES_BATCH];
  for (size_t first = begin; first < end; first += UBS_PLACES_BATCH) {
    const uint size = (uint)min((size_t)UBS_PLACES_BATCH, end - first);
    for (uint k = 0; k < size; k++) {
      const size_t i = first + k;
      const uint tiles = tile_counts[i], digit = depth_keys[i] & mask;
      if (!UBS_FORWARD_ONLY) slot_offsets[i] = slot;
      slot += tiles;
      const bool sorted = tiles > 0;
      const uint place = places[digit];
      places[digit] = place + (sorted ? 1 : 0);
      to[k] = sorted ? place : nowhere;
      UBS_PREFETCH_WRITE(pairs + to[k]);
    }
    for (uint k = 0; k < size; k++) pairs[to[k]] = (ulong)depth_keys[first + k] << 32 | (first + k);
  }
  if (c == 0 && totals) {
    ulong drawn = 0, intersections = 0;
    for (size_t k = 0; k < chunks; k++) {
      drawn += sums[k].x;
      intersections += sums[k].y;
    }
    totals[0] = drawn;
    totals[1] = intersections;
  }
}

// Returns the number of elements that a work-item processes. This is `chunk` if the host knows the total number of
// elements. If only the device knows the total, it is divided equally, and rounded up to whole cache lines.
static inline uint listed_chunk(uint chunk, uint count, __global const uint* counted) {
  const size_t items = get_global_size(0);
  return counted ? ((uint)max((size_t)1, (count + items - 1) / items) + 15) & ~15u : chunk;
}

// Returns a digit of the difference between the depth key of `pair` and `base`.
static inline uint radix_digit(ulong pair, uint base, uint shift, uint mask) {
  return (((uint)(pair >> 32) - base) >> shift) & mask;
}

UBS_CHUNK_KERNEL void radix_histogram(__global const ulong* restrict pairs, uint most,
                                      __global const uint* counted, uint chunk, uint base, uint shift,
                                      uint bits, __global uint* restrict histogram UBS_CORE_PARAMETERS) {
  const uint count = listed(most, counted);
  chunk = listed_chunk(chunk, count, counted);
  const size_t c = UBS_CORE_GROUP, begin = c * chunk, end = min(begin + chunk, (size_t)count);
  const uint mask = (1u << bits) - 1;
  __global uint* restrict bins = histogram + (c << bits);
  for (uint b = 0; b <= mask; b++) bins[b] = 0;
  for (size_t i = begin; i < end; i++) bins[radix_digit(pairs[i], base, shift, mask)]++;
}

// Moves the elements to their places in the output. The last pass writes ids_out, and pairs_out is null. The other
// passes write pairs_out, and ids_out is null.
UBS_CHUNK_KERNEL void radix_scatter(__global const ulong* restrict pairs, uint most,
                                    __global const uint* counted, uint chunk, uint base, uint shift,
                                    uint bits, __global uint* restrict histogram,
                                    __global const uint* restrict starts, __global ulong* restrict pairs_out,
                                    __global uint* restrict ids_out UBS_CORE_PARAMETERS) {
  const uint count = listed(most, counted);
  chunk = listed_chunk(chunk, count, counted);
  const size_t c = UBS_CORE_GROUP, begin = c * chunk, end = min(begin + chunk, (size_t)count);
  const uint mask = (1u << bits) - 1;
  __global uint* restrict places = histogram + (c << bits);
  for (uint b = 0; b <= mask; b++) places[b] += starts[b];
  uint to[UBS_PLACES_BATCH];
  for (size_t first = begin; first < end; first += UBS_PLACES_BATCH) {
    const uint size = (uint)min((size_t)UBS_PLACES_BATCH, end - first);
    for (uint k = 0; k < size; k++) {
      to[k] = places[radix_digit(pairs[first + k], base, shift, mask)]++;
      if (pairs_out)
        UBS_PREFETCH_WRITE(pairs_out + to[k]);
      else
        UBS_PREFETCH_WRITE(ids_out + to[k]);
    }
    for (uint k = 0; k < size; k++) {
      if (pairs_out)
        pairs_out[to[k]] = pairs[first + k];
      else
        ids_out[to[k]] = (uint)pairs[first + k];
    }
  }
}

// Computes the exclusive prefix sums down each column of a histogram of shape (chunks, bins). `totals` receives the sum
// of each column. One work-item processes a block of columns. The inner loop runs along a row, so that it is
// vectorised.
UBS_CHUNK_KERNEL void column_scan(__global uint* restrict histogram, uint chunks, uint bins, uint block,
                                  __global uint* restrict totals) {
  const size_t begin = get_global_id(0) * block, end = min(begin + block, (size_t)bins);
  for (size_t b = begin; b < end; b++) totals[b] = 0;
  for (uint c = 0; c < chunks; c++) {
    __global uint* restrict row = histogram + (size_t)c * bins;
    for (size_t b = begin; b < end; b++) {
      const uint here = row[b];
      row[b] = totals[b];
      totals[b] += here;
    }
  }
}

// Does the same as column_scan in a single work-item, and writes the prefix sums of the totals to `starts`. The host
// uses this kernel for small histograms, because for them an additional launch takes longer than the scan.
UBS_CHUNK_KERNEL void column_starts(__global uint* restrict histogram, uint chunks, uint bins,
                                    __global uint* restrict starts) {
  for (uint b = 0; b < bins; b++) starts[b] = 0;
  for (uint c = 0; c < chunks; c++) {
    __global uint* restrict row = histogram + (size_t)c * bins;
    for (uint b = 0; b < bins; b++) {
      const uint here = row[b];
      row[b] = starts[b];
      starts[b] += here;
    }
  }
  uint running = 0;
  for (uint b = 0; b < bins; b++) {
    const uint here = starts[b];
    starts[b] = running;
    running += here;
  }
  starts[bins] = running;
}

// Number of tiles of a batch. Rectangles are first expanded into a list of tiles, the batch, and then the batch is
// processed. These two loops have no unpredictable branches, whereas a direct loop over rows and columns causes two or
// three mispredicted branches per splat.
#ifndef UBS_LISTS_BATCH
#define UBS_LISTS_BATCH 1024
#endif
enum { kLanes = 16 };
UBS_FN uint16 iota(void) { return (uint16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15); }

// The rectangle of the splat that follows this number of splats later is prefetched. The rectangles of depth-ordered
// splats are scattered in memory, and without prefetching, the core does not start enough loads in advance. For 3
// million splats, prefetching reduces the time of tile_histogram from 31 to 11 ms, and that of tile_scatter from 127 to
// 50 ms.
#ifndef UBS_LISTS_AHEAD
#define UBS_LISTS_AHEAD 96
#endif

// Element w is ceil(256 / w). For k < 16 and w <= 16, (k * kReciprocal[w]) >> 8 is exactly k / w, rounded down.
__constant uint kReciprocal[17] = {0, 256, 128, 86, 64, 52, 43, 37, 32, 29, 26, 24, 22, 20, 19, 18, 16};

// Returns the tiles of a rectangle with at most 16 tiles. The values of further lanes have no meaning.
static inline uint16 small_rect_tiles(TileRect rect, uint tiles_x) {
  const uint width = tile_rect_width(rect);
  const uint16 row = (iota() * kReciprocal[width]) >> 8;
  return rect.y0 * tiles_x + rect.x0 + iota() + row * (tiles_x - width);
}

static inline void count_batch(const uint* batch, uint size, __global uint* restrict bins) {
  for (uint k = 0; k < size; k++) bins[batch[k]]++;
}

UBS_CHUNK_KERNEL void tile_histogram(__global const uint* restrict order,
                                     __global const uint2* restrict tile_rects, uint most,
                                     __global const uint* counted, uint chunk, uint tiles_x, uint tiles,
                                     __global uint* restrict histogram UBS_CORE_PARAMETERS) {
  const uint count = listed(most, counted);
  chunk = listed_chunk(chunk, count, counted);
  const size_t c = UBS_CORE_GROUP, begin = c * chunk, end = min(begin + chunk, (size_t)count);
  __global uint* restrict bins = histogram + c * tiles;
  uint batch[UBS_LISTS_BATCH + kLanes], size = 0;
  for (uint t = 0; t < tiles; t++) bins[t] = 0;
  for (size_t i = begin; i < end; i++) {
    UBS_PREFETCH(tile_rects + order[min(i + UBS_LISTS_AHEAD, end - 1)]);
    const TileRect rect = tile_rect(tile_rects[order[i]]);
    const uint area = tile_rect_area(rect);
    if (area <= kLanes) {
      vstore16(small_rect_tiles(rect, tiles_x), 0, batch + size);
      size += area;
    } else {
      for (uint y = rect.y0; y <= rect.y1; y++)
        for (uint x = rect.x0; x <= rect.x1; x++) bins[y * tiles_x + x]++;
    }
    if (size >= UBS_LISTS_BATCH) {
      count_batch(batch, size, bins);
      size = 0;
    }
  }
  count_batch(batch, size, bins);
}

typedef struct {
  uint tiles[UBS_LISTS_BATCH + kLanes], ids[UBS_LISTS_BATCH + kLanes];
  uint slots[UBS_LISTS_BATCH + kLanes];  // only used with a backward pass
} TileBatch;

// Replaces the tiles of the batch by the places of its intersections in the lists, and then writes the splats and slots
// of the batch to these places.
static inline void place_batch(TileBatch* batch, uint size, __global uint* restrict places,
                               __global uint* restrict sorted_ids, __global uint* restrict sorted_slots) {
  for (uint k = 0; k < size; k++) {
    const uint place = places[batch->tiles[k]]++;
    batch->tiles[k] = place;
    UBS_PREFETCH_WRITE(sorted_ids + place);
    if (!UBS_FORWARD_ONLY) UBS_PREFETCH_WRITE(sorted_slots + place);
  }
  for (uint k = 0; k < size; k++) {
    const uint place = batch->tiles[k];
    sorted_ids[place] = batch->ids[k];
    if (!UBS_FORWARD_ONLY) sorted_slots[place] = batch->slots[k];
  }
}

UBS_CHUNK_KERNEL void tile_scatter(
    __global const uint* restrict order, __global const uint2* restrict tile_rects,
    __global const uint* restrict slot_offsets, uint most, __global const uint* counted, uint chunk,
    uint tiles_x, uint tiles, __global uint* restrict histogram, __global const uint* restrict tile_ranges,
    __global uint* restrict sorted_ids, __global uint* restrict sorted_slots UBS_CORE_PARAMETERS) {
  const uint count = listed(most, counted);
  chunk = listed_chunk(chunk, count, counted);
  const size_t c = UBS_CORE_GROUP, begin = c * chunk, end = min(begin + chunk, (size_t)count);
  __global uint* restrict places = histogram + c * tiles;
  TileBatch batch;
  uint size = 0;
  for (uint t = 0; t < tiles; t++) places[t] += tile_ranges[t];
  for (size_t i = begin; i < end; i++) {
    const uint id = order[i], ahead = order[min(i + UBS_LISTS_AHEAD, end - 1)];
    UBS_PREFETCH(tile_rects + ahead);
    const TileRect rect = tile_rect(tile_rects[id]);
    const uint area = tile_rect_area(rect);
    uint slot = 0;
    if (!UBS_FORWARD_ONLY) {
      UBS_PREFETCH(slot_offsets + ahead);
      slot = slot_offsets[id];
    }
    const bool small = area <= kLanes;
    if (small) {
      vstore16(small_rect_tiles(rect, tiles_x), 0, batch.tiles + size);
      vstore16((uint16)id, 0, batch.ids + size);
      if (!UBS_FORWARD_ONLY) vstore16(slot + iota(), 0, batch.slots + size);
      size += area;
    }
    if (!small || size >= UBS_LISTS_BATCH) {
      place_batch(&batch, size, places, sorted_ids, sorted_slots);
      size = 0;
    }
    if (!small) {
      for (uint y = rect.y0; y <= rect.y1; y++) {
        for (uint x = rect.x0; x <= rect.x1; x++) {
          const uint place = places[y * tiles_x + x]++;
          sorted_ids[place] = id;
          if (!UBS_FORWARD_ONLY) sorted_slots[place] = slot++;
        }
      }
    }
  }
  place_batch(&batch, size, places, sorted_ids, sorted_slots);
}
