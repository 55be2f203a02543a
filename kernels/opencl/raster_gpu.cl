// SPDX-License-Identifier: Apache-2.0
// Rasteriser for GPUs: one work-group is one 16x16 tile, one work-item one pixel; splats pass through local
// memory in batches. Sixteen neighbouring work-items are a 4x4 block of pixels, and each block visits only
// the splats whose ellipse reaches it (bit words in local memory), so that a wave skips most of the list.
// No float atomics and a fixed order of all sums: the same inputs give the same bits.

#define UBS_BLOCK 4
#define UBS_BLOCKS_X (UBS_TILE / UBS_BLOCK)
#define UBS_BLOCKS (UBS_BLOCKS_X * UBS_BLOCKS_X)
#define UBS_LANES (UBS_BLOCK * UBS_BLOCK)
#define UBS_ITEMS (UBS_TILE * UBS_TILE)
#define UBS_FORWARD_WORDS (UBS_ITEMS / 32)
// Splats a batch of backward: fewer than work-items, to stay below 32 KiB of local memory.
#ifndef UBS_BACKWARD_BATCH
#define UBS_BACKWARD_BATCH 128
#endif
#define UBS_BACKWARD_WORDS (UBS_BACKWARD_BATCH / 32)
// Leading reals of a record that are kept in local memory (through depth or reach).
#define UBS_KEPT (13 + UBS_OPACITY_EXTENTS)
// Sums of blend_vjp, in the order of a gradient record.
#define UBS_SUMS 10

UBS_FN BlendSplat load_blend_splat(__local const float* record) {
  BlendSplat s;
  s.l00 = record[UBS_S_L00];
  s.l01 = record[UBS_S_L01];
  s.l11 = record[UBS_S_L11];
  s.opacity = record[UBS_S_OPACITY];
  s.beta = record[UBS_S_BETA];
  s.r = record[UBS_S_R];
  s.g = record[UBS_S_G];
  s.b = record[UBS_S_B];
  return s;
}

UBS_FN void load_record(__local float* to, __global const float* records, uint splat) {
#ifdef UBS_HALF_RECORDS
  float16 line = load_splat_record(records, splat);
  const float* values = (const float*)&line;
  for (int i = 0; i < UBS_KEPT; ++i) to[i] = values[i];
#else
  for (int i = 0; i < UBS_KEPT; ++i) to[i] = records[(ulong)splat * UBS_SPLAT_STRIDE + (uint)i];
#endif
}

// Bit b: the splat reaches block b of the tile whose corner is (left, top).
UBS_FN uint reached_blocks(__local const float* record, float left, float top) {
  CullSplat s = cull_splat(record[UBS_S_X] - left, record[UBS_S_Y] - top, record[UBS_S_L00], record[UBS_S_L01],
                           record[UBS_S_L11], UBS_OPACITY_EXTENTS ? record[UBS_S_REACH] : UBS_SUPPORT);
  uint blocks = 0;
  for (int by = 0; by < UBS_BLOCKS_X; ++by) {
    CullSpan down = cull_span(s.y, (float)(by * UBS_BLOCK) + 2.0f);
    for (int bx = 0; bx < UBS_BLOCKS_X; ++bx)
      if (cull_meets(s, cull_span(s.x, (float)(bx * UBS_BLOCK) + 2.0f), down))
        blocks |= 1u << (by * UBS_BLOCKS_X + bx);
  }
  return blocks;
}

// Enters splat k into the words of its blocks.
UBS_FN void enter_hits(__local uint* hits, int words, uint blocks, int k) {
  for (; blocks != 0; blocks &= blocks - 1)
    atomic_or(&hits[lowest_bit32(blocks) * words + k / 32], 1u << (k % 32));
}

__kernel __attribute__((reqd_work_group_size(UBS_ITEMS, 1, 1))) void raster_gpu_forward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height, float background_r,
    float background_g, float background_b, __global float* image, __global float* transmittance,
    __global float* depth, __global ushort* masks) {
  __local float batch[UBS_ITEMS * UBS_KEPT];
  __local uint hits[UBS_BLOCKS * UBS_FORWARD_WORDS];
  __local uint alive_blocks;
  int item = (int)get_local_id(0), tile = (int)get_group_id(0);
  int block = item / UBS_LANES, lane = item % UBS_LANES;
  int left = tile % tiles_x * UBS_TILE, top = tile / tiles_x * UBS_TILE;
  int column = left + block % UBS_BLOCKS_X * UBS_BLOCK + lane % UBS_BLOCK;
  int row = top + block / UBS_BLOCKS_X * UBS_BLOCK + lane / UBS_BLOCK;
  float x = (float)column + 0.5f, y = (float)row + 0.5f;
  uint first = tile_ranges[tile], last = tile_ranges[tile + 1];

  float open = column < width && row < height ? 1.0f : 0.0f;
  float rest = 1.0f, r = 0.0f, g = 0.0f, b = 0.0f;
#ifdef UBS_DEPTH
  float weighted_depth = 0.0f, weight = 0.0f;
#endif
  uint at = first;
  for (; at < last; at += UBS_ITEMS) {
    if (item < UBS_BLOCKS * UBS_FORWARD_WORDS) hits[item] = 0;
    if (item == 0) alive_blocks = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (open > 0.0f) atomic_or(&alive_blocks, 1u << block);
    barrier(CLK_LOCAL_MEM_FENCE);
    uint alive = UBS_SKIP_FINISHED ? alive_blocks : (1u << UBS_BLOCKS) - 1u;
    if (alive == 0) break;  // the same for the whole group
    if (at + (uint)item < last) {
      __local float* record = batch + item * UBS_KEPT;
      load_record(record, records, sorted_ids[at + (uint)item]);
      uint blocks = reached_blocks(record, (float)left, (float)top) & alive;
#if !UBS_FORWARD_ONLY
      masks[sorted_slots[at + (uint)item]] = (ushort)blocks;
#endif
      enter_hits(hits, UBS_FORWARD_WORDS, blocks, item);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int word = 0; word < UBS_FORWARD_WORDS; ++word) {
      for (uint bits = hits[block * UBS_FORWARD_WORDS + word]; bits != 0 && (UBS_SKIP_FINISHED ? open > 0.0f : 1);
           bits &= bits - 1) {
        __local const float* record = batch + (word * 32 + lowest_bit32(bits)) * UBS_KEPT;
        BlendSplat s = load_blend_splat(record);
        BlendStep step = blend_step(blend_alpha(s, record[UBS_S_X] - x, record[UBS_S_Y] - y), open);
        open = step.open;
        rest = step.composited ? step.open : rest;
        r += step.weight * s.r;
        g += step.weight * s.g;
        b += step.weight * s.b;
#ifdef UBS_DEPTH
        weighted_depth += step.weight * record[UBS_S_DEPTH];
        weight += step.weight;
#endif
      }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
#if !UBS_FORWARD_ONLY
  for (uint k = at + (uint)item; k < last; k += UBS_ITEMS) masks[sorted_slots[k]] = 0;
#endif

  int pitch = tiles_x * UBS_TILE;
  int plane = pitch * tiles_y * UBS_TILE;
  int pixel = row * pitch + column;
  image[pixel] = r + rest * background_r;
  image[plane + pixel] = g + rest * background_g;
  image[2 * plane + pixel] = b + rest * background_b;
  transmittance[pixel] = rest;
#ifdef UBS_DEPTH
  depth[pixel] = blend_expected_depth(weighted_depth, weight);
#endif
}

#if !UBS_FORWARD_ONLY
// Sums over blocks by sub-group operations (1) or by local memory alone (0). The host says 1 where the device
// has sub-groups.
#ifndef UBS_SUBGROUPS
#define UBS_SUBGROUPS 0
#endif
#if UBS_SUBGROUPS
#ifdef cl_khr_subgroups
#pragma OPENCL EXTENSION cl_khr_subgroups : enable
#endif
#ifndef UBS_SUBGROUP_LOCALS  // for tests that emulate sub-groups in local memory
#define UBS_SUBGROUP_LOCALS
#define UBS_SUBGROUP_PARAMETER
#define UBS_SUBGROUP_ARGUMENT
#endif
// Nothing is assumed about which work-items form a sub-group: it may hold a part of a block, one block or
// several. Its items of one block have a leader, that of the lowest lane, who writes their sum; the leaders
// of a block are added in order of lanes, so that the order of sums is fixed for a device.
UBS_FN int leads_block(int block, int lane, int first, int last UBS_SUBGROUP_PARAMETER) {
  int leads = 0;
  for (int b = first; b <= last; ++b) {
    int lowest = sub_group_reduce_min(block == b ? lane : UBS_LANES);
    leads |= block == b && lane == lowest;
  }
  return leads;
}

// sums of the sub-group's items of each block -> values of their leaders; all items of the sub-group call it.
UBS_FN void reduce_blocks(const float* sums, int block, int leads, int first, int last,
                          __local float* value UBS_SUBGROUP_PARAMETER) {
  for (int b = first; b <= last; ++b) {
    for (int i = 0; i < UBS_SUMS; ++i) {
      float sum = sub_group_reduce_add(block == b ? sums[i] : 0.0f);
      if (leads && block == b) value[i * UBS_BLOCKS * (UBS_LANES + 1)] = sum;
    }
  }
}
#endif

// The k-th hits of all blocks are done together, one splat a block ("round"): the pixels put their ten
// values into local memory, 160 work-items sum them over a block, ten add the blocks to their splats.
__kernel __attribute__((reqd_work_group_size(UBS_ITEMS, 1, 1))) void raster_gpu_backward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    __global const float* image, __global const float* v_image, __global const ushort* masks,
    UBS_SLOTS(__global float*)) {
  __local float batch[UBS_BACKWARD_BATCH * UBS_KEPT];
  __local float totals[UBS_BACKWARD_BATCH * UBS_SUMS];
  __local float values[UBS_SUMS * UBS_BLOCKS * (UBS_LANES + 1)];  // padded against bank conflicts
  __local float block_sums[UBS_SUMS * UBS_BLOCKS];
  __local uint hits[UBS_BLOCKS * UBS_BACKWARD_WORDS];
  __local int current[2 * UBS_BLOCKS];  // splat of each block in this round, -1 for none; two rounds
#if UBS_SUBGROUPS
  __local uint leaders[UBS_BLOCKS];  // bit l: lane l of the block writes a sum
  UBS_SUBGROUP_LOCALS
#endif
  int item = (int)get_local_id(0), tile = (int)get_group_id(0);
  int block = item / UBS_LANES, lane = item % UBS_LANES;
  int column = tile % tiles_x * UBS_TILE + block % UBS_BLOCKS_X * UBS_BLOCK + lane % UBS_BLOCK;
  int row = tile / tiles_x * UBS_TILE + block / UBS_BLOCKS_X * UBS_BLOCK + lane / UBS_BLOCK;
  float x = (float)column + 0.5f, y = (float)row + 0.5f;
  uint first = tile_ranges[tile], last = tile_ranges[tile + 1];

  int pitch = tiles_x * UBS_TILE;
  int plane = pitch * tiles_y * UBS_TILE;
  int pixel = row * pitch + column;
  float v_r = v_image[pixel], v_g = v_image[plane + pixel], v_b = v_image[2 * plane + pixel];
  float remaining = image[pixel] * v_r + image[plane + pixel] * v_g + image[2 * plane + pixel] * v_b;
  float open = column < width && row < height ? 1.0f : 0.0f;

#if UBS_SUBGROUPS
  int first_block = sub_group_reduce_min(block), last_block = sub_group_reduce_max(block);
  int leads = leads_block(block, lane, first_block, last_block UBS_SUBGROUP_ARGUMENT);
  if (item < UBS_BLOCKS) leaders[item] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (leads) atomic_or(&leaders[block], 1u << lane);
  barrier(CLK_LOCAL_MEM_FENCE);
#endif

  for (uint at = first; at < last; at += UBS_BACKWARD_BATCH) {
    if (item < UBS_BLOCKS * UBS_BACKWARD_WORDS) hits[item] = 0;
    for (int i = item; i < UBS_BACKWARD_BATCH * UBS_SUMS; i += UBS_ITEMS) totals[i] = 0.0f;
    barrier(CLK_LOCAL_MEM_FENCE);
    uint blocks = 0, slot = 0;
    if (item < UBS_BACKWARD_BATCH && at + (uint)item < last) {
      slot = sorted_slots[at + (uint)item];
      blocks = UBS_MASKED_BACKWARD ? masks[slot] : (1u << UBS_BLOCKS) - 1u;
      if (blocks != 0) {
        load_record(batch + item * UBS_KEPT, records, sorted_ids[at + (uint)item]);
        enter_hits(hits, UBS_BACKWARD_WORDS, blocks, item);
      }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    int rounds = 0;
    for (int i = 0; i < UBS_BLOCKS; ++i) {
      int count = 0;
      for (int word = 0; word < UBS_BACKWARD_WORDS; ++word)
        count += (int)popcount(hits[i * UBS_BACKWARD_WORDS + word]);
      rounds = max(rounds, count);
    }

    int word = 0;
    uint bits = hits[block * UBS_BACKWARD_WORDS];
    for (int round = 0; round < rounds; ++round) {
      __local int* now = current + round % 2 * UBS_BLOCKS;
      while (bits == 0 && ++word < UBS_BACKWARD_WORDS) bits = hits[block * UBS_BACKWARD_WORDS + word];
      int k = bits != 0 ? word * 32 + lowest_bit32(bits) : -1;
      bits &= bits - 1;
      if (lane == 0) now[block] = k;
      __local float* value = values + block * (UBS_LANES + 1) + lane;
#if UBS_SUBGROUPS
      float sums[UBS_SUMS] = {0.0f};
#endif
      if (k >= 0) {
        __local const float* record = batch + k * UBS_KEPT;
        BlendSplat s = load_blend_splat(record);
        float dx = record[UBS_S_X] - x, dy = record[UBS_S_Y] - y;
        BlendAlpha a = blend_alpha(s, dx, dy);
        BlendStep step = blend_step(a, open);
        remaining = blend_remaining(s, step, remaining, v_r, v_g, v_b);
        BlendSums v = blend_vjp(blend_no_sums(), s, a, step, open, remaining, v_r, v_g, v_b);
        open = step.open;
        const float all[UBS_SUMS] = {v.hp, v.hq, v.hpp, v.hpq, v.hqq, v.opacity, v.log_beta, v.r, v.g, v.b};
#if UBS_SUBGROUPS
        for (int i = 0; i < UBS_SUMS; ++i) sums[i] = all[i];
#else
        for (int i = 0; i < UBS_SUMS; ++i) value[i * UBS_BLOCKS * (UBS_LANES + 1)] = all[i];
#endif
      }
#if UBS_SUBGROUPS
      reduce_blocks(sums, block, leads, first_block, last_block, value UBS_SUBGROUP_ARGUMENT);
#endif
      barrier(CLK_LOCAL_MEM_FENCE);
      if (item < UBS_SUMS * UBS_BLOCKS && now[item % UBS_BLOCKS] >= 0) {
        float sum = 0.0f;
#if UBS_SUBGROUPS
        for (uint lanes = leaders[item % UBS_BLOCKS]; lanes != 0; lanes &= lanes - 1)
          sum += values[item * (UBS_LANES + 1) + lowest_bit32(lanes)];
#else
        for (int i = 0; i < UBS_LANES; ++i) sum += values[item * (UBS_LANES + 1) + i];
#endif
        block_sums[item] = sum;
      }
      barrier(CLK_LOCAL_MEM_FENCE);
      if (item < UBS_SUMS) {
        for (int i = 0; i < UBS_BLOCKS; ++i)
          if (now[i] >= 0) totals[now[i] * UBS_SUMS + item] += block_sums[item * UBS_BLOCKS + i];
      }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (blocks != 0) {
      __local const float* t = totals + item * UBS_SUMS;
      BlendFactors f = blend_factors(load_blend_splat(batch + item * UBS_KEPT));
      __global float* to = UBS_SLOT_PIECE(slot) + (ulong)UBS_SLOT_IN_PIECE(slot) * UBS_SLOT_WORDS;
#ifdef UBS_HALF_GRADIENTS
      store_slot((float16)(f.xp * t[0], f.yp * t[0] + f.yq * t[1], f.square * t[2], f.square * t[3],
                           f.square * t[4], t[5], UBS_LN2 * t[6], t[7], t[8], t[9], 0.0f, 0.0f, (float4)(0.0f)),
                 to);
#else
      vstore4((float4)(f.xp * t[0], f.yp * t[0] + f.yq * t[1], f.square * t[2], f.square * t[3]), 0, to);
      vstore4((float4)(f.square * t[4], t[5], UBS_LN2 * t[6], t[7]), 1, to);
      vstore4((float4)(t[8], t[9], 0.0f, 0.0f), 2, to);
      vstore4((float4)(0.0f), 3, to);
#endif
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}
#endif
