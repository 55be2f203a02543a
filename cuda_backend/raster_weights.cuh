// SPDX-License-Identifier: Apache-2.0
// What each splat does to the pixels of a tile (MeasureWeights of host/device/stages.hpp; kernels/opencl/weights.cl is
// the same for OpenCL): one block a tile, one thread a pixel, over the lists of a forward pass. Alphas are those of
// the rasteriser to the bit. For tools.

constexpr int kWeightBatch = 32;  // entries between two barriers

struct WeightsShared {
  unsigned most[kWeightBatch];  // bits of the largest weight: order of floats that are not negative
};

UBS_KERNEL void __launch_bounds__(kTilePixels)
    measure_weights(const float* records, const unsigned* sorted_ids, const unsigned* sorted_slots,
                    const unsigned* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                    const unsigned short* masks, float* weights) {
  __shared__ WeightsShared shared;
  const int thread = static_cast<int>(threadIdx.x), tile = static_cast<int>(blockIdx.x);
  const TilePixel pixel = tile_pixel(tile, thread, tiles_x, width, height);
  const unsigned first = tile_ranges[tile], last = tile_ranges[tile + 1];
  float open = pixel.inside ? 1.0f : 0.0f;
  for (unsigned at = first; at < last; at += kWeightBatch) {
    const unsigned entries = last - at < kWeightBatch ? last - at : kWeightBatch;
    if (thread < kWeightBatch) shared.most[thread] = 0;
    __syncthreads();
    for (unsigned k = 0; k < entries; ++k) {
      if (!(masks[sorted_slots[at + k]] >> pixel.block & 1)) continue;
      const SplatRecord splat = load_splat(records, sorted_ids[at + k]);
      const BlendAlpha a = blend_alpha(blend_splat(splat), splat.place.x - pixel.x, splat.place.y - pixel.y);
      const float weight = open * a.alpha;
      open = blend_step(a, open).open;
      if (weight > 0.0f) atomicMax(&shared.most[k], __float_as_uint(weight));
    }
    __syncthreads();
    if (thread < static_cast<int>(entries))
      weights[sorted_slots[at + static_cast<unsigned>(thread)]] = __uint_as_float(shared.most[thread]);
    __syncthreads();
  }
  (void)tiles_y;
}
