// SPDX-License-Identifier: Apache-2.0
// Measures how much each splat affects each tile. The measure is the largest weight that the splat has in any pixel of
// the tile when colours are blended (MeasureWeights of host/device/stages.hpp). opencl/weights.cl is the version for
// CPUs. One work-group processes one tile with the lists of a forward pass. The alphas are bit-identical to those of
// the rasteriser.

enum { kWeightBatch = 32 };  // number of list entries between two barriers

// Writes, for each slot, the maximum over the tile's pixels of transmittance * alpha. A splat that would finish a pixel
// is not composited in this pixel, but counts there, because without this splat the pixel would continue with the next
// one. If the weight is 0, the image does not depend on the splat in this tile.
UBS_KERNEL UBS_GROUP(kItems) void measure_weights(
    UBS_GLOBAL const float* records, UBS_GLOBAL const uint* sorted_ids, UBS_GLOBAL const uint* sorted_slots,
    UBS_GLOBAL const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    UBS_GLOBAL const ushort* masks, UBS_GLOBAL float* weights) {
  // Bit patterns of the largest weights. Non-negative floats have the same order as their bit patterns.
  UBS_SHARED uint most[kWeightBatch];
  int item = ubs_local_id(), tile = (int)ubs_group_id();
  TilePixel pixel = tile_pixel(tile, item, tiles_x, tiles_y, width, height);
  uint first = tile_ranges[tile], last = tile_ranges[tile + 1];
  float open = pixel.inside ? 1.0f : 0.0f;
  for (uint at = first; at < last; at += kWeightBatch) {
    uint entries = last - at < kWeightBatch ? last - at : kWeightBatch;
    if (item < kWeightBatch) most[item] = 0;
    UBS_BARRIER();
    for (uint k = 0; k < entries; ++k) {
      if ((masks[sorted_slots[at + k]] >> pixel.block & 1) == 0) continue;
      SplatRecord s = load_record(records, sorted_ids[at + k]);
      BlendAlpha a = blend_alpha(blend_splat(s.place, s.shape, s.colour), s.place.x - pixel.x, s.place.y - pixel.y);
      float weight = open * a.alpha;
      open = blend_step(a, open).open;
      if (weight > 0.0f) ubs_atomic_max(&most[k], ubs_as_uint(weight));
    }
    UBS_BARRIER();
    if (item < (int)entries) weights[sorted_slots[at + (uint)item]] = ubs_as_float(most[item]);
    UBS_BARRIER();
  }
}
