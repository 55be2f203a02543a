// SPDX-License-Identifier: Apache-2.0
// Tile lists for CPUs: one work-item a chunk of consecutive elements, in groups of one. Depth order by a
// least-significant-digit radix sort, whose first pass is part of counting, then ONE stable counting pass by
// tile that walks the rectangles of the depth-ordered splats twice (count, place): no list of unsorted
// intersections is ever written. Histograms are (chunk, bin): a chunk's row stays in its core's cache. What
// is sorted is a 64-bit word, depth key above index, so that a bin is one open cache line.
#define UBS_CHUNK_KERNEL __kernel __attribute__((reqd_work_group_size(1, 1, 1)))

// Scattered words are written in batches: first all places, asked for on the way, then the words. In an
// iteration nothing of the lists is left in the caches, and stores wait for their lines one after the other
// (300K splats: count_write 0.65 -> 0.36 ms, tile_scatter 1.78 -> 1.15).
#ifndef UBS_PLACES_BATCH
#define UBS_PLACES_BATCH 512
#endif

// Of each chunk: drawn splats, their tiles, least and largest key of those to sort; and the histogram of the
// first digit of `bits` bits, in a loop of its own, so that the other one vectorises (300K splats: 0.17 ->
// 0.11 ms).
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

// Slots, and the first pass of the sort. `histogram` as column_scan leaves it, `starts` the first place of
// each bin. totals, where given: drawn splats, intersections. A splat that is not listed is written as well,
// to a place behind all others (a cache line a chunk): a branch on it would not be predictable.
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

// The elements of a work-item: `chunk`, or, where only the device knows how many there are, an equal share of
// them in whole cache lines.
static inline uint listed_chunk(uint chunk, uint count, __global const uint* counted) {
  const size_t items = get_global_size(0);
  return counted ? ((uint)max((size_t)1, (count + items - 1) / items) + 15) & ~15u : chunk;
}

// Digits of the key's height above `base`.
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

// One of the outputs is null: ids are what the last pass writes.
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

// Exclusive prefix sum down each column of a (chunks, bins) histogram; totals: sum of the column.
// One work-item a block of columns; the inner loop runs along the row, which vectorises.
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

// The same in one work-item, and `starts` is the prefix sum of the totals: for histograms that are so small
// that launches are what a scan costs.
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

// Rectangles are first unrolled into a short list of tiles, then the list is worked off: two loops without
// unpredictable branches (walking rows and columns directly mispredicts two or three times a splat).
#ifndef UBS_LISTS_BATCH
#define UBS_LISTS_BATCH 1024
#endif
enum { kLanes = 16 };
UBS_FN uint16 iota(void) { return (uint16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15); }

// The rectangles of depth-ordered splats lie anywhere in memory, and more of them must be on the way than the
// core finds by itself: 3M splats, histogram 31 -> 11 ms, scatter 127 -> 50 ms.
#ifndef UBS_LISTS_AHEAD
#define UBS_LISTS_AHEAD 96
#endif

// ceil(256 / w): (k * reciprocal) >> 8 is k / w exactly for k < 16, w <= 16.
__constant uint kReciprocal[17] = {0, 256, 128, 86, 64, 52, 43, 37, 32, 29, 26, 24, 22, 20, 19, 18, 16};

// The first 16 tiles of a rectangle of at most 16 tiles; lanes beyond its area are not meaningful.
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

// Slots are for backward only.
typedef struct {
  uint tiles[UBS_LISTS_BATCH + kLanes], ids[UBS_LISTS_BATCH + kLanes];
  uint slots[UBS_LISTS_BATCH + kLanes];
} TileBatch;

// Takes the tiles' places in their stead.
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
