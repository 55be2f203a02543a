// SPDX-License-Identifier: Apache-2.0
// Buckets: 32 consecutive entries of a tile's list, the unit of the backward rasteriser by splats, which starts each
// from the state of the pixels that forward wrote before it. Places follow from tile_ranges without a prefix sum: with
// first = 32 a + r and last = 32 b + s a tile has ceil((last - first) / 32) <= b - a + 1 buckets, so that
// first / 32 + tile is a place for its first bucket that no other tile reaches. At most one place a tile stays empty.

constexpr unsigned kBucket = 32;

// Place of the first bucket of a tile; of `tiles`, given the number of intersections: how many places there are.
__device__ __forceinline__ unsigned first_bucket(const unsigned* tile_ranges, unsigned tile) {
  return tile_ranges[tile] / kBucket + tile;
}

// The tile whose place `bucket` is, in [0, tiles).
__device__ __forceinline__ unsigned tile_of_bucket(const unsigned* tile_ranges, unsigned tiles, unsigned bucket) {
  unsigned low = 0, high = tiles;
  while (high - low > 1) {
    const unsigned middle = low + (high - low) / 2;
    if (first_bucket(tile_ranges, middle) <= bucket)
      low = middle;
    else
      high = middle;
  }
  return low;
}

// Open transmittance and colour so far of pixel `thread` of the tile (blocks of 4x4 in order) before its bucket
// `number`. Before the first one they are known, so that there is a state for each 32 intersections at most.
__device__ __forceinline__ float4* bucket_state(float* states, unsigned first, unsigned number, int thread) {
  const size_t bucket = first / kBucket + number - 1;
  return reinterpret_cast<float4*>(states) + bucket * kTilePixels + static_cast<size_t>(thread);
}
