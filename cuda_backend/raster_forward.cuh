// SPDX-License-Identifier: Apache-2.0
// Forward rasteriser: a block a tile, a thread a pixel. Splats pass through shared memory 256 at a time; each 4x4 block of
// pixels visits only the splats whose ellipse reaches it. The two halves of a warp visit different splats in one
// instruction stream. Without masks (forward only) these are not written.

constexpr int kForwardBatch = kTilePixels;
constexpr int kForwardWords = kForwardBatch / 32;
constexpr int kTogether = 3;  // splats whose alphas a thread computes, none waiting for another, before it blends them

// Bit b: the splat's ellipse reaches 4x4 block b of the tile whose corner is (left, top).
__device__ __forceinline__ unsigned reached_blocks(const SplatRecord& r, float left, float top) {
  const CullSplat s = cull_splat(r.place.x - left, r.place.y - top, r.place.z, r.place.w, r.shape.x, r.reach);
  unsigned blocks = 0;
#pragma unroll
  for (int by = 0; by < kBlocksAcross; ++by) {
    const CullSpan down = cull_span(s.y, static_cast<float>(by * kBlockSide + kBlockSide / 2));
#pragma unroll
    for (int bx = 0; bx < kBlocksAcross; ++bx) {
      const CullSpan across = cull_span(s.x, static_cast<float>(bx * kBlockSide + kBlockSide / 2));
      if (cull_meets(s, across, down)) blocks |= 1u << (by * kBlocksAcross + bx);
    }
  }
  return blocks;
}

__device__ __forceinline__ void put_state(float* states, unsigned list_first, unsigned segment, int thread,
                                          float4 state) {
  const size_t at = static_cast<size_t>(list_states(list_first, segment)) * kTilePixels + thread;
  reinterpret_cast<float4*>(states)[at] = state;
}

struct ForwardShared {
  SplatBatch<kForwardBatch> batch;
  unsigned hits[kBlocks * kForwardWords];
  unsigned alive[kWarps];  // blocks with an open pixel, by the warp that owns them
};

// Blocks of the tile with a pixel that still takes light; the same value in every thread.
__device__ __forceinline__ unsigned alive_blocks(ForwardShared& shared, bool open, int thread) {
  const unsigned lanes = __ballot_sync(kWholeWarp, open);
  if (thread % 32 == 0)
    shared.alive[thread / 32] = ((lanes & 0xffffu) != 0 ? 1u : 0u) | ((lanes >> kHalfWarp) != 0 ? 2u : 0u);
  __syncthreads();
  unsigned alive = 0;
#pragma unroll
  for (int warp = 0; warp < kWarps; ++warp) alive |= shared.alive[warp] << (2 * warp);
  return alive;
}

UBS_KERNEL void __launch_bounds__(kForwardBatch)
    raster_forward(const float* records, const unsigned* sorted_ids, const unsigned* sorted_slots,
                   const unsigned* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                   float background_r, float background_g, float background_b, float* image,
                   float* transmittance, float* depth, unsigned short* masks, float* states) {
  __shared__ ForwardShared shared;
  __shared__ float depths[UBS_DEPTH ? kForwardBatch : 1];
  const int thread = static_cast<int>(threadIdx.x), tile = static_cast<int>(blockIdx.x);
  const TilePixel pixel = tile_pixel(tile, thread, tiles_x, width, height);
  const unsigned first = tile_ranges[tile], last = tile_ranges[tile + 1];

  float open = pixel.inside ? 1.0f : 0.0f;
  float rest = 1.0f, r = 0.0f, g = 0.0f, b = 0.0f;
  float weighted_depth = 0.0f, weight = 0.0f;  // with UBS_DEPTH
  unsigned at = first;
  for (; at < last; at += kForwardBatch) {
    const unsigned alive = alive_blocks(shared, open > 0.0f, thread);
    if (alive == 0) break;  // the same in the whole block
    if (states && at != first && (at - first) % kListSegment == 0)
      put_state(states, first, (at - first) / kListSegment, thread, make_float4(open, r, g, b));
    const unsigned mine = at + static_cast<unsigned>(thread);
    unsigned blocks = 0;
    if (mine < last) {
      const SplatRecord record = load_splat(records, sorted_ids[mine]);
      put_splat(shared.batch, thread, record);
      if (UBS_DEPTH) depths[thread] = record.depth;
      blocks = reached_blocks(record, static_cast<float>(pixel.left), static_cast<float>(pixel.top)) & alive;
      if (masks) masks[sorted_slots[mine]] = static_cast<unsigned short>(blocks);
    }
    transpose_blocks(blocks, shared.hits + thread / 32, kForwardWords, thread % 32);
    __syncthreads();
    for (int word = 0; word < kForwardWords; ++word) {
      unsigned bits = shared.hits[pixel.block * kForwardWords + word];
      while (bits != 0 && open > 0.0f) {
        int k[kTogether];
        BatchSplat s[kTogether];
        BlendAlpha a[kTogether];
#pragma unroll
        for (int i = 0; i < kTogether; ++i) {
          const bool exists = i == 0 || bits != 0;
          k[i] = exists ? word * 32 + __ffs(static_cast<int>(bits)) - 1 : k[0];
          bits &= bits - 1;
          s[i] = batch_splat(shared.batch, k[i]);
          a[i] = blend_alpha(s[i].splat, s[i].x - pixel.x, s[i].y - pixel.y);
          if (!exists) a[i].alpha = 0.0f;
        }
#pragma unroll
        for (int i = 0; i < kTogether; ++i) {
          const BlendStep step = blend_step(a[i], open);
          open = step.open;
          rest = step.composited ? step.open : rest;
          r += step.weight * s[i].splat.r;
          g += step.weight * s[i].splat.g;
          b += step.weight * s[i].splat.b;
          if (UBS_DEPTH) {
            weighted_depth += step.weight * depths[k[i]];
            weight += step.weight;
          }
        }
      }
    }
    // No barrier here: the one in alive_blocks comes before anything read above is written again.
  }
  for (unsigned k = at + static_cast<unsigned>(thread); masks && k < last; k += kForwardBatch)
    masks[sorted_slots[k]] = 0;
  for (unsigned segment = (at - first + kListSegment - 1) / kListSegment;
       states && segment * kListSegment < last - first; ++segment)
    put_state(states, first, segment, thread, make_float4(0.0f, 0.0f, 0.0f, 0.0f));

  const int plane = tiles_x * kTileSide * tiles_y * kTileSide;
  image[pixel.index] = r + rest * background_r;
  image[plane + pixel.index] = g + rest * background_g;
  image[2 * plane + pixel.index] = b + rest * background_b;
  transmittance[pixel.index] = rest;
  if (UBS_DEPTH) depth[pixel.index] = blend_expected_depth(weighted_depth, weight);
}
