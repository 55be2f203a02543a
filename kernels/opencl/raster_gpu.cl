// SPDX-License-Identifier: Apache-2.0
// Rasteriser for GPUs: one work-group is one 16x16 tile (backward: a segment of its list, map/list_segments.h), one
// work-item one pixel; splats pass through local memory in batches. Sixteen neighbouring work-items are a 4x4 block of pixels, and each block visits only
// the splats whose ellipse reaches it (bit words in local memory), so that a wave skips most of the list.
// No float atomics and a fixed order of all sums: the same inputs give the same bits.

enum {
  kBlock = 4,
  kBlocksX = kTileSide / kBlock,
  kBlocks = kBlocksX * kBlocksX,
  kLanes = kBlock * kBlock,
  kItems = kTileSide * kTileSide,
  kForwardWords = kItems / 32,
};
// Splats a batch of backward: fewer than work-items, to stay below 32 KiB of local memory.
#ifndef UBS_BACKWARD_BATCH
#define UBS_BACKWARD_BATCH 128
#endif
enum { kBackwardWords = UBS_BACKWARD_BATCH / 32 };
// Splats whose sums by block are in local memory at a time: 16 or 32. Fewer leave room for more groups, and make more
// groups wait for their slowest block.
#ifndef UBS_BACKWARD_TURN
#define UBS_BACKWARD_TURN 32
#endif
enum { kTurn = UBS_SUBGROUPS ? UBS_BACKWARD_TURN : 16 };  // without exchange there is room for no more

// The pixel of a work-item.
typedef struct {
  int block, lane;
  int left, top;    // corner of the tile [px]
  int index, plane; // in a plane, of which size
  float x, y;       // centre [px]
  int inside;       // of the image
} TilePixel;

UBS_FN TilePixel tile_pixel(int tile, int item, int tiles_x, int tiles_y, int width, int height) {
  TilePixel p;
  p.block = item / kLanes;
  p.lane = item % kLanes;
  p.left = tile % tiles_x * kTileSide;
  p.top = tile / tiles_x * kTileSide;
  int column = p.left + p.block % kBlocksX * kBlock + p.lane % kBlock;
  int row = p.top + p.block / kBlocksX * kBlock + p.lane / kBlock;
  int pitch = tiles_x * kTileSide;
  p.index = row * pitch + column;
  p.plane = pitch * tiles_y * kTileSide;
  p.x = (float)column + 0.5f;
  p.y = (float)row + 0.5f;
  p.inside = column < width && row < height;
  return p;
}

// What blending reads of a record, in words of 16 and 8 bytes, and what is read of it once.
typedef struct {
  float4 place, shape;  // x, y, L00, L01; L11, opacity, beta, r
  float2 colour;        // g, b
  float depth, reach;
} SplatRecord;

UBS_FN SplatRecord load_record(__global const float* records, uint splat) {
  SplatRecord s;
  __global const float4* line = (__global const float4*)records + (ulong)splat * (kSplatStride / 4);
  s.place = line[0];
  s.shape = line[1];
  s.colour = line[2].xy;
  float2 last = line[3].xy;
  s.depth = last.x;
  s.reach = UBS_OPACITY_EXTENTS ? last.y : UBS_SUPPORT;
  return s;
}

UBS_FN BlendSplat blend_splat(float4 place, float4 shape, float2 colour) {
  BlendSplat s;
  s.l00 = place.z;
  s.l01 = place.w;
  s.l11 = shape.x;
  s.opacity = shape.y;
  s.beta = shape.z;
  s.r = shape.w;
  s.g = colour.x;
  s.b = colour.y;
  return s;
}

// Bit b: the splat reaches block b of the tile whose corner is (left, top).
UBS_FN uint reached_blocks(SplatRecord r, float left, float top) {
  CullSplat s = cull_splat(r.place.x - left, r.place.y - top, r.place.z, r.place.w, r.shape.x, r.reach);
  uint blocks = 0;
  for (int by = 0; by < kBlocksX; ++by) {
    CullSpan down = cull_span(s.y, (float)(by * kBlock) + 2.0f);
    for (int bx = 0; bx < kBlocksX; ++bx)
      if (cull_meets(s, cull_span(s.x, (float)(bx * kBlock) + 2.0f), down))
        blocks |= 1u << (by * kBlocksX + bx);
  }
  return blocks;
}

// Turns the blocks of splats into words of blocks: bit k of hits[block * words + word] is splat word * 32 + k.
UBS_FN void transpose_blocks(__local const uint4* blocks, __local uint* hits, int words, int item) {
  if (item >= kBlocks * words) return;
  int block = item % kBlocks, word = item / kBlocks;
  uint bits = 0;
  UBS_UNROLL for (int i = 0; i < 8; ++i) {
    uint4 four = (blocks[word * 8 + i] >> (uint)block) & 1u;
    bits |= (four.x | four.y << 1 | four.z << 2 | four.w << 3) << (4 * i);
  }
  hits[block * words + word] = bits;
}

UBS_FN void put_state(__global float* states, uint list_first, uint segment, int item, float4 state) {
  ((__global float4*)states)[(ulong)list_states(list_first, segment) * kItems + (ulong)item] = state;
}

__kernel __attribute__((reqd_work_group_size(kItems, 1, 1))) void raster_gpu_forward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height, float background_r,
    float background_g, float background_b, __global float* image, __global float* transmittance,
    __global float* depth, __global ushort* masks, __global float* states) {
  __local float4 places[kItems], shapes[kItems];
  __local float2 colours[kItems];
  __local float depths[UBS_DEPTH ? kItems : 1];
  __local uint4 reached[kItems / 4];
  __local uint hits[kBlocks * kForwardWords];
  __local uint alive_blocks[2];  // with an open pixel, of this batch and the next
  int item = (int)get_local_id(0), tile = (int)get_group_id(0);
  TilePixel pixel = tile_pixel(tile, item, tiles_x, tiles_y, width, height);
  uint first = tile_ranges[tile], last = tile_ranges[tile + 1];

  float open = pixel.inside ? 1.0f : 0.0f;
  float rest = 1.0f, r = 0.0f, g = 0.0f, b = 0.0f;
  float weighted_depth = 0.0f, weight = 0.0f;  // with UBS_DEPTH
  if (item == 0) alive_blocks[0] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (open > 0.0f) atomic_or(&alive_blocks[0], 1u << pixel.block);
  barrier(CLK_LOCAL_MEM_FENCE);
  uint at = first;
  for (int turn = 0; at < last; at += kItems, turn ^= 1) {
    uint alive = alive_blocks[turn];
    if (alive == 0) break;  // the same for the whole group
    if (!UBS_FORWARD_ONLY && at != first && (at - first) % kListSegment == 0)
      put_state(states, first, (at - first) / kListSegment, item, (float4)(open, r, g, b));
    uint blocks = 0;
    if (at + (uint)item < last) {
      SplatRecord record = load_record(records, sorted_ids[at + (uint)item]);
      places[item] = record.place;
      shapes[item] = record.shape;
      colours[item] = record.colour;
      if (UBS_DEPTH) depths[item] = record.depth;
      blocks = reached_blocks(record, (float)pixel.left, (float)pixel.top) & alive;
      if (!UBS_FORWARD_ONLY) masks[sorted_slots[at + (uint)item]] = (ushort)blocks;
    }
    ((__local uint*)reached)[item] = blocks;
    if (item == 0) alive_blocks[turn ^ 1] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    transpose_blocks(reached, hits, kForwardWords, item);
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int word = 0; word < kForwardWords; ++word) {
      for (uint bits = hits[pixel.block * kForwardWords + word]; bits != 0 && open > 0.0f; bits &= bits - 1) {
        int k = word * 32 + lowest_bit32(bits);
        float4 place = places[k];
        BlendSplat s = blend_splat(place, shapes[k], colours[k]);
        BlendStep step = blend_step(blend_alpha(s, place.x - pixel.x, place.y - pixel.y), open);
        open = step.open;
        rest = step.composited ? step.open : rest;
        r += step.weight * s.r;
        g += step.weight * s.g;
        b += step.weight * s.b;
        if (UBS_DEPTH) {
          weighted_depth += step.weight * depths[k];
          weight += step.weight;
        }
      }
    }
    if (open > 0.0f) atomic_or(&alive_blocks[turn ^ 1], 1u << pixel.block);
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  for (uint k = at + (uint)item; !UBS_FORWARD_ONLY && k < last; k += kItems) masks[sorted_slots[k]] = 0;
  for (uint segment = (at - first + kListSegment - 1) / kListSegment;
       !UBS_FORWARD_ONLY && segment * kListSegment < last - first; ++segment)
    put_state(states, first, segment, item, (float4)(0.0f));

  image[pixel.index] = r + rest * background_r;
  image[pixel.plane + pixel.index] = g + rest * background_g;
  image[2 * pixel.plane + pixel.index] = b + rest * background_b;
  transmittance[pixel.index] = rest;
  if (UBS_DEPTH) depth[pixel.index] = blend_expected_depth(weighted_depth, weight);
}

#if !UBS_FORWARD_ONLY
enum { kSums = 10 };  // of blend_vjp

// Sums over the pixels of the splats of a turn, by block: the first eight in words of four, the others in words of
// two. One place more a splat than there are blocks, against bank conflicts.
enum {
  kPlaces = kBlocks + 1,
  kParts = kTurn * kPlaces,
};
typedef struct {
  __local float4* fours;  // (2, kParts)
  __local float2* twos;   // (kParts)
} BlockSums;

UBS_FN __local float* block_sum(BlockSums sums, int place, int value) {
  __local float* fours = (__local float*)(sums.fours + value / 4 * kParts + place) + value % 4;
  __local float* twos = (__local float*)(sums.twos + place) + (value - 8);
  return value < 8 ? fours : twos;
}

// Both ways to sum ten values over the 16 lanes of a block take the same tree: lanes 8, then 4, 2 and 1 apart.
#if UBS_SUBGROUPS
// At each step a lane hands over the half of its values that its partner keeps, so that 11 exchanges do instead of 40.
// Lane l ends with the sum of value sum_of_lane(l).
#define UBS_EXCHANGE(low, high, distance) \
  (((lane & distance) != 0 ? high : low) + lane_xor##distance((lane & distance) != 0 ? low : high))
UBS_FN float sum_over_block(const float* v, int lane UBS_EXCHANGE_PARAMETER) {
  float a0 = UBS_EXCHANGE(v[0], v[5], 8), a1 = UBS_EXCHANGE(v[1], v[6], 8), a2 = UBS_EXCHANGE(v[2], v[7], 8);
  float a3 = UBS_EXCHANGE(v[3], v[8], 8), a4 = UBS_EXCHANGE(v[4], v[9], 8);
  float b0 = UBS_EXCHANGE(a0, a3, 4), b1 = UBS_EXCHANGE(a1, a4, 4), b2 = UBS_EXCHANGE(a2, 0.0f, 4);
  float c0 = UBS_EXCHANGE(b0, b2, 2), c1 = UBS_EXCHANGE(b1, 0.0f, 2);
  return UBS_EXCHANGE(c0, c1, 1);
}
// -1: none.
UBS_FN int sum_of_lane(int lane) {
  int in_third = lane & 3, third = (lane & 4) != 0 ? 3 : 0;
  int holds = third == 0 ? in_third < 3 : in_third < 2;
  return holds ? ((lane & 8) != 0 ? 5 : 0) + third + in_third : -1;
}
#else
// values: of the lanes of a block.
UBS_FN float sum_over_lanes(__local const float* values) {
  float sums[kLanes / 2];
  UBS_UNROLL for (int l = 0; l < kLanes / 2; ++l) sums[l] = values[l] + values[l + kLanes / 2];
  UBS_UNROLL for (int distance = kLanes / 4; distance > 0; distance /= 2)
    UBS_UNROLL for (int l = 0; l < kLanes / 4; ++l)
      if (l < distance) sums[l] += sums[l + distance];
  return sums[0];
}
#endif

// The batch of backward: the next splats of the list that any block composites, in list order.
typedef struct {
  __local float4 *places, *shapes;
  __local float2* colours;
  __local uint* slots;
  __local uint4* blocks;
} Queue;

// Work-items 0 .. 4 kTurn - 1 add the sums of a turn over blocks, in their order, four values each, and write
// the gradient of the splat to its slot.
UBS_FN void write_slots(Queue queue, BlockSums sums, int first, int count, int item, UBS_SLOTS(__global float*)) {
  int place = item / 4, part = item % 4, k = first + place;
  if (place >= kTurn || k >= count) return;
  float4 sum = (float4)(0.0f);
  for (uint blocks = ((__local uint*)queue.blocks)[k]; blocks != 0; blocks &= blocks - 1) {
    int at = place * kPlaces + lowest_bit32(blocks);
    if (part < 2)
      sum += sums.fours[part * kParts + at];
    else if (part == 2)
      sum.xy += sums.twos[at];
  }
  BlendFactors f = blend_factors(blend_splat(queue.places[k], queue.shapes[k], queue.colours[k]));
  if (part == 0)
    sum = (float4)(f.xp * sum.x, f.yp * sum.x + f.yq * sum.y, f.square * sum.z, f.square * sum.w);
  else if (part == 1)
    sum = (float4)(f.square * sum.x, sum.y, UBS_LN2 * sum.z, sum.w);
  uint slot = queue.slots[k];
  ((__global float4*)UBS_SLOT_PIECE(slot))[(ulong)UBS_SLOT_IN_PIECE(slot) * (kGradStride / 4) + (ulong)part] = sum;
}

// Splats that no pixel of the tile composites (mask 0) are squeezed out of the list first. Blocks then visit their
// splats of a turn, each at its own pace where lanes can exchange values, else all the k-th of theirs together: the
// sums go through local memory, whose barriers are for all.
__kernel UBS_WAVES __attribute__((reqd_work_group_size(kItems, 1, 1))) void raster_gpu_backward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    __global const float* image, __global const float* v_image, __global const ushort* masks,
    __global const float* states, UBS_SLOTS(__global float*)) {
  __local float4 places[UBS_BACKWARD_BATCH], shapes[UBS_BACKWARD_BATCH], fours[2 * kParts];
  __local float2 colours[UBS_BACKWARD_BATCH], twos[kParts];
  __local uint4 blocks[UBS_BACKWARD_BATCH / 4];
  __local uint slots_of[UBS_BACKWARD_BATCH], hits[kBlocks * kBackwardWords], kept[kBackwardWords];
#if !UBS_SUBGROUPS
  __local float values[kSums * kBlocks * (kLanes + 1)];
  __local int places_now[kBlocks];  // of the splats that blocks visit, -1 for none
#endif
  UBS_EXCHANGE_LOCALS
  Queue queue = {places, shapes, colours, slots_of, blocks};
  BlockSums sums = {fours, twos};
  int item = ubs_item();
  ListSegment segment = list_segment(tile_ranges, tiles_x * tiles_y, (uint)get_group_id(0));
  if (segment.first == segment.last) return;
  TilePixel pixel = tile_pixel(segment.tile, item, tiles_x, tiles_y, width, height);
  float4 state = (float4)(pixel.inside ? 1.0f : 0.0f, 0.0f, 0.0f, 0.0f);
  if (segment.number > 0) state = ((__global const float4*)states)[(ulong)segment.states * kItems + (ulong)item];

  float v_r = v_image[pixel.index], v_g = v_image[pixel.plane + pixel.index],
        v_b = v_image[2 * pixel.plane + pixel.index];
  float remaining = (image[pixel.index] - state.y) * v_r + (image[pixel.plane + pixel.index] - state.z) * v_g +
                    (image[2 * pixel.plane + pixel.index] - state.w) * v_b;
  float open = state.x;

  if (item < kBackwardWords) kept[item] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint at = segment.first; at < segment.last; at += UBS_BACKWARD_BATCH) {
    uint slot = 0, mask = 0;
    if (item < UBS_BACKWARD_BATCH && at + (uint)item < segment.last) {
      slot = sorted_slots[at + (uint)item];
      mask = masks[slot];
      if (mask != 0) atomic_or(&kept[item / 32], 1u << (item % 32));
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    int count = 0, place = 0;
    for (int word = 0; word < kBackwardWords; ++word) {
      uint bits = kept[word];
      count += (int)popcount(bits);
      if (word <= item / 32) place += (int)popcount(word < item / 32 ? bits : bits & ((1u << (item % 32)) - 1u));
    }
    if (mask != 0) {
      SplatRecord record = load_record(records, sorted_ids[at + (uint)item]);
      places[place] = record.place;
      shapes[place] = record.shape;
      colours[place] = record.colour;
      slots_of[place] = slot;
      ((__local uint*)blocks)[place] = mask;
    }
    if (item >= count && item < UBS_BACKWARD_BATCH) ((__local uint*)blocks)[item] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    transpose_blocks(blocks, hits, kBackwardWords, item);
    if (item < kBackwardWords) kept[item] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);

    for (int turn = 0; turn < count; turn += kTurn) {
      // The bits of the turn alone.
      int word = turn / 32;
      uint shift = turn % 32, of_turn = 0xffffffffu >> (32 - kTurn);
      uint bits = hits[pixel.block * kBackwardWords + word] >> shift & of_turn;
#if UBS_SUBGROUPS
      while (any_of_wave(bits != 0)) {
#else
      int rounds = 0;
      for (int i = 0; i < kBlocks; ++i)
        rounds = max(rounds, (int)popcount(hits[i * kBackwardWords + word] >> shift & of_turn));
      for (; rounds > 0; --rounds) {
#endif
        int active = bits != 0;
        int k = active ? lowest_bit32(bits) : 0;
        bits &= bits - 1;
        float4 splat_place = places[turn + k];
        BlendSplat s = blend_splat(splat_place, shapes[turn + k], colours[turn + k]);
        BlendAlpha a = blend_alpha(s, splat_place.x - pixel.x, splat_place.y - pixel.y);
        BlendStep step = blend_step(a, open);
        float left = blend_remaining(s, step, remaining, v_r, v_g, v_b);
        BlendSums v = blend_vjp(blend_no_sums(), s, a, step, open, left, v_r, v_g, v_b);
        remaining = active ? left : remaining;
        open = active ? step.open : open;
        const float all[kSums] = {v.hp, v.hq, v.hpp, v.hpq, v.hqq, v.opacity, v.log_beta, v.r, v.g, v.b};
        int to = k * kPlaces;
#if UBS_SUBGROUPS
        float sum = sum_over_block(all, pixel.lane UBS_EXCHANGE_ARGUMENT);
        int mine = sum_of_lane(pixel.lane);
        if (active && mine >= 0) *block_sum(sums, to + pixel.block, mine) = sum;
#else
        if (pixel.lane == 0) places_now[pixel.block] = active ? to + pixel.block : -1;
        UBS_UNROLL for (int i = 0; i < kSums; ++i)
          values[(i * kBlocks + pixel.block) * (kLanes + 1) + pixel.lane] = all[i];
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < kSums * kBlocks && places_now[item % kBlocks] >= 0)
          *block_sum(sums, places_now[item % kBlocks], item / kBlocks) =
              sum_over_lanes(values + item * (kLanes + 1));
        barrier(CLK_LOCAL_MEM_FENCE);
#endif
      }
      barrier(CLK_LOCAL_MEM_FENCE);
      write_slots(queue, sums, turn, count, item, UBS_SLOT_ARGUMENTS);
      barrier(CLK_LOCAL_MEM_FENCE);
    }
  }
}
#endif
