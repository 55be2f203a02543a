// SPDX-License-Identifier: Apache-2.0
// What each splat does to the pixels of a tile: its largest blended weight, and by how much pixels can change
// when splats are replaced or taken away. One work-item a tile over the lists of a forward pass; the program is
// raster_cpu.cl and this, so that alphas are those of the rasteriser to the bit. For tools: correct anywhere, fast
// nowhere but on CPUs.

UBS_FN float largest_lane(vreal v) {
  float lanes[UBS_VW];
  UBS_STORE(v, lanes);
  float most = lanes[0];
  for (int lane = 1; lane < UBS_VW; ++lane) most = max(most, lanes[lane]);
  return most;
}

// weights (by slot): max over the tile's pixels of transmittance * alpha. A splat that would finish a pixel counts
// although it is not composited there: without it the pixel would go on. 0: the image does not depend on the splat.
// partners (by place in the list): record in `others` that takes the splat's place, UBS_PARTNER_SAME or
// UBS_PARTNER_NONE; null: all the same.
// changes (pixels): sum over splats of transmittance * |alpha - alpha of the partner|; to the splat, included, that
// finishes the pixel. stops (pixels): transmittance of a finished pixel, else 0.
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void measure_weights(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    __global const ushort* masks, __global const uint* partners, __global const float* others,
    __global float* weights, __global float* changes, __global float* stops) {
  Tile tile = find_tile((uint)get_group_id(0), tile_ranges, tiles_x, tiles_y, width, height);
  Centres centres;
  make_centres(&centres, tile.left, tile.top);
  vreal open[kBlocks][kParts], change[kBlocks][kParts], stop[kBlocks][kParts];
  for (int block = 0; block < kBlocks; ++block)
    for (int part = 0; part < kParts; ++part) {
      open[block][part] = initial_open(part, block_left(tile, block), block_top(tile, block), width, height);
      change[block][part] = stop[block][part] = V(0.0);
    }
  for (uint at = tile.first; at < tile.last; ++at) {
    uint slot = sorted_slots[at];
    uint partner = partners ? partners[at] : UBS_PARTNER_SAME;
    // The mask knows which blocks the splat reaches, not which its partner does.
    uint blocks = partner == UBS_PARTNER_SAME || partner == UBS_PARTNER_NONE ? masks[slot] : (1u << kBlocks) - 1;
    __global const float* record = records + (ulong)sorted_ids[at] * kSplatStride;
    __global const float* replaced = record;
    if (partner != UBS_PARTNER_SAME && partner != UBS_PARTNER_NONE)
      replaced = others + (ulong)partner * kSplatStride;
    vreal most = V(0.0);
    for (; blocks != 0; blocks &= blocks - 1) {
      int block = lowest_bit32(blocks);
      for (int part = 0; part < kParts; ++part) {
        vreal x = centres.x[block % kBlocksX][part], y = centres.y[block / kBlocksX][part];
        vreal before = open[block][part];
        BlendAlpha a = blend_alpha(load_blend_splat(record), record[kSplatX] - x, record[kSplatY] - y);
        BlendStep step = blend_step(a, before);
        most = ubs_max(most, before * a.alpha);
        if (partner != UBS_PARTNER_SAME) {
          vreal alpha = V(0.0);
          if (partner != UBS_PARTNER_NONE)
            alpha = blend_alpha(load_blend_splat(replaced), replaced[kSplatX] - x, replaced[kSplatY] - y).alpha;
          change[block][part] += before * ubs_max(a.alpha - alpha, alpha - a.alpha);
        }
        stop[block][part] = ((before > V(0.0)) & !step.composited) ? before : stop[block][part];
        open[block][part] = step.open;
      }
    }
    if (weights) weights[slot] = largest_lane(most);
  }
  for (int block = 0; block < kBlocks; ++block) {
    if (changes) store_block(change[block], changes + block_corner(tile, block), tile.pitch);
    if (stops) store_block(stop[block], stops + block_corner(tile, block), tile.pitch);
  }
}
