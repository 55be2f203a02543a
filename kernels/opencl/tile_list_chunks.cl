// SPDX-License-Identifier: Apache-2.0
// Tile lists for CPUs: one work-item a chunk of consecutive elements, in groups of one. Depth order by a
// least-significant-digit radix sort, then ONE stable counting pass by tile that walks the rectangles of the
// depth-ordered splats twice (count, place): no list of unsorted intersections is ever written.
// Histograms are (chunk, bin): a chunk's row stays in its core's cache. Counts of what is listed: amount.h.
#define UBS_CHUNK_KERNEL __kernel __attribute__((reqd_work_group_size(1, 1, 1)))
#define UBS_RADIX_BINS (1 << UBS_RADIX_BITS)
#ifndef UBS_FIRST_SHIFT  // bits of the key that are not sorted by
#define UBS_FIRST_SHIFT 0
#endif

// sums[chunk] = drawn splats, sums[chunks + chunk] = their tiles: one prefix sum serves both.
UBS_CHUNK_KERNEL void count_sums(__global const uint* restrict tile_counts, uint count, uint chunk,
                                 __global ulong* restrict sums) {
  const size_t c = get_global_id(0), begin = c * chunk, end = min(begin + chunk, (size_t)count);
  uint drawn = 0;
  ulong tiles = 0;
  for (size_t i = begin; i < end; i++) {
    drawn += tile_counts[i] > 0 ? 1 : 0;
    tiles += tile_counts[i];
  }
  sums[c] = drawn;
  sums[get_global_size(0) + c] = tiles;
}

// `sums`: exclusive prefix sum of the above (2 chunks + 1 elements). totals: drawn splats, intersections.
// Every splat is written at the next place, whether drawn or not, until the chunk's last place is taken: the
// branch is predictable where one on the count itself is not, and no other chunk's place is touched.
UBS_CHUNK_KERNEL void count_write(__global const uint* restrict tile_counts, uint count, uint chunk,
                                  __global const ulong* restrict sums, __global uint* restrict visible_ids,
                                  __global uint* restrict slot_offsets, __global ulong* restrict totals) {
  const size_t c = get_global_id(0), chunks = get_global_size(0);
  const size_t begin = c * chunk, end = min(begin + chunk, (size_t)count);
  size_t place = sums[c];
  const size_t last = sums[c + 1];
  uint slot = (uint)(sums[chunks + c] - sums[chunks]);
  for (size_t i = begin; i < end; i++) {
    const uint tiles = tile_counts[i];
#if !UBS_FORWARD_ONLY
    slot_offsets[i] = slot;
#endif
    slot += tiles;
#if UBS_VIEW_CULL
    if (place < last) visible_ids[place] = (uint)i;
#else
    visible_ids[i] = (uint)i;
#endif
    place += tiles > 0 ? 1 : 0;
  }
  if (c == 0) {
    totals[0] = sums[chunks];
    totals[1] = sums[2 * chunks] - sums[chunks];
  }
}

// First pass: collects the keys of the drawn splats on the way.
UBS_CHUNK_KERNEL void radix_histogram_first(__global const uint* restrict visible_ids,
                                            __global const uint* restrict depth_keys, UBS_AMOUNT(count),
                                            uint chunk, __global uint* restrict keys,
                                            __global uint* restrict histogram) {
  UBS_TAKE_CHUNKS(count, chunk)
  const size_t c = get_global_id(0), begin = c * chunk, end = min(begin + chunk, (size_t)count);
  uint bins[UBS_RADIX_BINS];
  for (uint b = 0; b < UBS_RADIX_BINS; b++) bins[b] = 0;
  for (size_t i = begin; i < end; i++) {
    const uint key = depth_keys[visible_ids[i]];
    keys[i] = key;
    bins[(key >> UBS_FIRST_SHIFT) & (UBS_RADIX_BINS - 1)]++;
  }
  for (uint b = 0; b < UBS_RADIX_BINS; b++) histogram[c * UBS_RADIX_BINS + b] = bins[b];
}

UBS_CHUNK_KERNEL void radix_histogram(__global const uint* restrict keys, UBS_AMOUNT(count), uint chunk,
                                      uint shift, __global uint* restrict histogram) {
  UBS_TAKE_CHUNKS(count, chunk)
  const size_t c = get_global_id(0), begin = c * chunk, end = min(begin + chunk, (size_t)count);
  uint bins[UBS_RADIX_BINS];
  for (uint b = 0; b < UBS_RADIX_BINS; b++) bins[b] = 0;
  for (size_t i = begin; i < end; i++) bins[(keys[i] >> shift) & (UBS_RADIX_BINS - 1)]++;
  for (uint b = 0; b < UBS_RADIX_BINS; b++) histogram[c * UBS_RADIX_BINS + b] = bins[b];
}

// `histogram` as column_scan leaves it, `starts` the first place of each bin. keys_out null: last pass.
UBS_CHUNK_KERNEL void radix_scatter(__global const uint* restrict keys, __global const uint* restrict ids,
                                    UBS_AMOUNT(count), uint chunk, uint shift,
                                    __global const uint* restrict histogram,
                                    __global const uint* restrict starts, __global uint* restrict keys_out,
                                    __global uint* restrict ids_out) {
  UBS_TAKE_CHUNKS(count, chunk)
  const size_t c = get_global_id(0), begin = c * chunk, end = min(begin + chunk, (size_t)count);
  uint places[UBS_RADIX_BINS];
  for (uint b = 0; b < UBS_RADIX_BINS; b++) places[b] = starts[b] + histogram[c * UBS_RADIX_BINS + b];
  for (size_t i = begin; i < end; i++) {
    const uint key = keys[i], place = places[(key >> shift) & (UBS_RADIX_BINS - 1)]++;
    if (keys_out) keys_out[place] = key;
    ids_out[place] = ids[i];
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

// Rectangles are first unrolled into a short list of tiles, then the list is worked off: two loops without
// unpredictable branches (walking rows and columns directly mispredicts two or three times a splat).
#ifndef UBS_LISTS_BATCH
#define UBS_LISTS_BATCH 1024
#endif
#define UBS_LANES 16
#define UBS_IOTA ((uint16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))

// The rectangles of depth-ordered splats lie anywhere in memory, and more of them must be on the way than the
// core finds by itself: 3M splats, histogram 31 -> 11 ms, scatter 127 -> 50 ms.
#ifndef UBS_LISTS_AHEAD
#define UBS_LISTS_AHEAD 48
#endif

// ceil(256 / w): (k * reciprocal) >> 8 is k / w exactly for k < 16, w <= 16.
__constant uint kReciprocal[17] = {0, 256, 128, 86, 64, 52, 43, 37, 32, 29, 26, 24, 22, 20, 19, 18, 16};

// The first 16 tiles of a rectangle of at most 16 tiles; lanes beyond its area are not meaningful.
static inline uint16 small_rect_tiles(TileRect rect, uint tiles_x) {
  const uint width = tile_rect_width(rect);
  const uint16 row = (UBS_IOTA * kReciprocal[width]) >> 8;
  return rect.y0 * tiles_x + rect.x0 + UBS_IOTA + row * (tiles_x - width);
}

static inline void count_batch(const uint* batch, uint size, __global uint* restrict bins) {
  for (uint k = 0; k < size; k++) bins[batch[k]]++;
}

UBS_CHUNK_KERNEL void tile_histogram(__global const uint* restrict order,
                                     __global const uint2* restrict tile_rects, UBS_AMOUNT(count), uint chunk,
                                     uint tiles_x, uint tiles, __global uint* restrict histogram) {
  UBS_TAKE_CHUNKS(count, chunk)
  const size_t c = get_global_id(0), begin = c * chunk, end = min(begin + chunk, (size_t)count);
  __global uint* restrict bins = histogram + c * tiles;
  uint batch[UBS_LISTS_BATCH + UBS_LANES], size = 0;
  for (uint t = 0; t < tiles; t++) bins[t] = 0;
  for (size_t i = begin; i < end; i++) {
    UBS_PREFETCH(tile_rects + order[min(i + UBS_LISTS_AHEAD, end - 1)]);
    const TileRect rect = tile_rect(tile_rects[order[i]]);
    const uint area = tile_rect_area(rect);
    if (area <= UBS_LANES) {
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
  uint tiles[UBS_LISTS_BATCH + UBS_LANES], ids[UBS_LISTS_BATCH + UBS_LANES];
#if !UBS_FORWARD_ONLY
  uint slots[UBS_LISTS_BATCH + UBS_LANES];
#endif
} TileBatch;

static inline void place_batch(const TileBatch* batch, uint size, __global uint* restrict places,
                               __global uint* restrict sorted_ids, __global uint* restrict sorted_slots) {
  for (uint k = 0; k < size; k++) {
    const uint place = places[batch->tiles[k]]++;
    sorted_ids[place] = batch->ids[k];
#if !UBS_FORWARD_ONLY
    sorted_slots[place] = batch->slots[k];
#endif
  }
}

UBS_CHUNK_KERNEL void tile_scatter(__global const uint* restrict order,
                                   __global const uint2* restrict tile_rects,
                                   __global const uint* restrict slot_offsets, UBS_AMOUNT(count), uint chunk,
                                   uint tiles_x, uint tiles, __global uint* restrict histogram,
                                   __global const uint* restrict tile_ranges,
                                   __global uint* restrict sorted_ids, __global uint* restrict sorted_slots) {
  UBS_TAKE_CHUNKS(count, chunk)
  const size_t c = get_global_id(0), begin = c * chunk, end = min(begin + chunk, (size_t)count);
  __global uint* restrict places = histogram + c * tiles;
  TileBatch batch;
  uint size = 0;
  for (uint t = 0; t < tiles; t++) places[t] += tile_ranges[t];
  for (size_t i = begin; i < end; i++) {
    const uint id = order[i], ahead = order[min(i + UBS_LISTS_AHEAD, end - 1)];
    UBS_PREFETCH(tile_rects + ahead);
    const TileRect rect = tile_rect(tile_rects[id]);
    const uint area = tile_rect_area(rect);
#if !UBS_FORWARD_ONLY
    UBS_PREFETCH(slot_offsets + ahead);
    uint slot = slot_offsets[id];
#endif
    const bool small = area <= UBS_LANES;
    if (small) {
      vstore16(small_rect_tiles(rect, tiles_x), 0, batch.tiles + size);
      vstore16((uint16)id, 0, batch.ids + size);
#if !UBS_FORWARD_ONLY
      vstore16(slot + UBS_IOTA, 0, batch.slots + size);
#endif
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
#if !UBS_FORWARD_ONLY
          sorted_slots[place] = slot++;
#endif
        }
      }
    }
  }
  place_batch(&batch, size, places, sorted_ids, sorted_slots);
}
