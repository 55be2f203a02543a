// SPDX-License-Identifier: Apache-2.0
// Measures how much each splat affects each tile. The measure is the largest weight that the splat has in any pixel of
// the tile when colours are blended (MeasureWeights of host/device/stages.hpp). One work-item processes one tile with
// the lists of a forward pass. The program consists of raster_cpu.cl and this file, so that the alphas are
// bit-identical to those of the rasteriser. The kernel is correct on all devices, but fast only on CPUs.

UBS_FN float largest_lane(vreal v) {
  float lanes[UBS_VW];
  UBS_STORE(v, lanes);
  float most = lanes[0];
  for (int lane = 1; lane < UBS_VW; ++lane) most = max(most, lanes[lane]);
  return most;
}

// Writes, for each slot, the maximum over the tile's pixels of transmittance * alpha. If a splat would finish a pixel,
// it is not composited in this pixel. The pixel still counts, because without this splat it would continue with the
// next one. If the weight is 0, the image does not depend on the splat in this tile.
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void measure_weights(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    __global const ushort* masks, __global float* weights) {
  Tile tile = find_tile((uint)get_group_id(0), tile_ranges, tiles_x, tiles_y, width, height);
  Centres centres;
  make_centres(&centres, tile.left, tile.top);
  vreal open[kBlocks][kParts];
  for (int block = 0; block < kBlocks; ++block)
    for (int part = 0; part < kParts; ++part)
      open[block][part] = initial_open(part, block_left(tile, block), block_top(tile, block), width, height);
  for (uint at = tile.first; at < tile.last; ++at) {
    uint slot = sorted_slots[at];
    __global const float* record = records + (ulong)sorted_ids[at] * kSplatStride;
    vreal most = V(0.0);
    for (uint blocks = masks[slot]; blocks != 0; blocks &= blocks - 1) {
      int block = lowest_bit32(blocks);
      for (int part = 0; part < kParts; ++part) {
        vreal x = centres.x[block % kBlocksX][part], y = centres.y[block / kBlocksX][part];
        vreal before = open[block][part];
        BlendAlpha a = blend_alpha(load_blend_splat(record), record[kSplatX] - x, record[kSplatY] - y);
        most = ubs_max(most, before * a.alpha);
        open[block][part] = blend_step(a, before).open;
      }
    }
    weights[slot] = largest_lane(most);
  }
}
