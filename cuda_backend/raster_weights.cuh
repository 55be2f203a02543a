// SPDX-License-Identifier: Apache-2.0
// What each splat does to the pixels of a tile (MeasureWeights of host/device/stages.hpp; kernels/opencl/weights.cl is
// the same for OpenCL): one block a tile, one thread a pixel, over the lists of a forward pass. Alphas are those of
// the rasteriser to the bit. For tools.

constexpr int kWeightBatch = 32;  // entries between two barriers

struct WeightsShared {
  unsigned most[kWeightBatch];  // bits of the largest weight: order of floats that are not negative
};

// One entry of the list at one pixel.
struct PixelChange {
  float open, change, stop;
};
__device__ __forceinline__ float alpha_at(const SplatRecord& s, const TilePixel& pixel) {
  return blend_alpha(blend_splat(s), s.place.x - pixel.x, s.place.y - pixel.y).alpha;
}
// Returns transmittance * alpha.
__device__ __forceinline__ float weigh(const SplatRecord& s, const TilePixel& pixel, unsigned partner,
                                       const float* others, PixelChange& p) {
  const float before = p.open;
  const BlendAlpha a = blend_alpha(blend_splat(s), s.place.x - pixel.x, s.place.y - pixel.y);
  const BlendStep step = blend_step(a, before);
  if (partner != UBS_PARTNER_SAME) {
    const float alpha = partner != UBS_PARTNER_NONE ? alpha_at(load_splat(others, partner), pixel) : 0.0f;
    p.change += before * ubs_max(a.alpha - alpha, alpha - a.alpha);
  }
  if (before > 0.0f && !step.composited) p.stop = before;
  p.open = step.open;
  return before * a.alpha;
}

UBS_KERNEL void __launch_bounds__(kTilePixels)
    measure_weights(const float* records, const unsigned* sorted_ids, const unsigned* sorted_slots,
                    const unsigned* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                    const unsigned short* masks, const unsigned* partners, const float* others, float* weights,
                    float* changes, float* stops) {
  __shared__ WeightsShared shared;
  const int thread = static_cast<int>(threadIdx.x), tile = static_cast<int>(blockIdx.x);
  const TilePixel pixel = tile_pixel(tile, thread, tiles_x, width, height);
  const unsigned first = tile_ranges[tile], last = tile_ranges[tile + 1];
  PixelChange p = {pixel.inside ? 1.0f : 0.0f, 0.0f, 0.0f};
  for (unsigned at = first; at < last; at += kWeightBatch) {
    const unsigned entries = last - at < kWeightBatch ? last - at : kWeightBatch;
    if (thread < kWeightBatch) shared.most[thread] = 0;
    __syncthreads();
    for (unsigned k = 0; k < entries; ++k) {
      const unsigned partner = partners ? partners[at + k] : UBS_PARTNER_SAME;
      const bool replaced = partner != UBS_PARTNER_SAME && partner != UBS_PARTNER_NONE;
      // The mask knows which blocks the splat reaches, not which its partner does.
      if (!replaced && !(masks[sorted_slots[at + k]] >> pixel.block & 1)) continue;
      const float weight = weigh(load_splat(records, sorted_ids[at + k]), pixel, partner, others, p);
      if (weight > 0.0f) atomicMax(&shared.most[k], __float_as_uint(weight));
    }
    __syncthreads();
    if (weights && thread < static_cast<int>(entries))
      weights[sorted_slots[at + static_cast<unsigned>(thread)]] = __uint_as_float(shared.most[thread]);
    __syncthreads();
  }
  (void)tiles_y;
  if (changes) changes[pixel.index] = p.change;
  if (stops) stops[pixel.index] = p.stop;
}
