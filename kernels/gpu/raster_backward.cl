// SPDX-License-Identifier: Apache-2.0
// This file contains the backward rasteriser for GPUs. One work-group processes one segment of a tile's list
// (list_segments.h), front to back as in the forward pass (math/blend.h). Splats that no pixel of the tile composites
// (mask 0) are skipped. The ten sums of a splat are added in a fixed order: first over the 16 pixels of a block, then
// over the blocks. The sums of each pair of tile and splat are written once, to a separate slot. There are no float
// atomics, so the same inputs give bit-identical results.

// Number of splats per batch. It is less than the number of work-items, so that the kernel needs less than 32 KiB of
// local memory.
#ifndef UBS_BACKWARD_BATCH
#define UBS_BACKWARD_BATCH 128
#endif
// Number of splats per turn, 16 or 32. The splats of a batch are processed in several turns, because each splat has a
// separate sum for each block of the tile, and local memory only has space for the sums of one turn. With fewer splats
// per turn, more work-groups fit on a compute unit, but work-groups wait more often for their slowest block.
#ifndef UBS_BACKWARD_TURN
#define UBS_BACKWARD_TURN 32
#endif

enum {
  kBackwardWords = UBS_BACKWARD_BATCH / 32,
  // Without exchange between lanes, local memory has no space for more than 16 splats.
  kTurn = UBS_SUBGROUPS ? UBS_BACKWARD_TURN : 16,
  kSums = 10,                                      // number of sums in blend_vjp()
  kPlaces = kBlocks + 1,  // stride from splat to splat in the sums: kBlocks + 1, to avoid bank conflicts
  kParts = kTurn * kPlaces,
};

typedef struct {
  float4 places[UBS_BACKWARD_BATCH], shapes[UBS_BACKWARD_BATCH];
  float4 sums[kSums * kParts / 4];  // see sum_place()
  uint blocks[UBS_BACKWARD_BATCH], slots[UBS_BACKWARD_BATCH];
  float2 colours[UBS_BACKWARD_BATCH];
#if UBS_ABSGRAD
  uint ids[UBS_BACKWARD_BATCH];
#endif
  uint hits[kBlocks * kBackwardWords], kept[kBackwardWords];
#if !UBS_SUBGROUPS
  float values[kSums * kBlocks * (kLanes + 1)];
  int places_now[kBlocks];  // for each block, the place of the sum that it currently computes, or -1
#endif
} BackwardShared;

// Describes where one of the ten sums is stored in BackwardShared::sums, for all splats of the turn and all blocks.
// Sums 0 to 3 are stored first, in words of four floats, then sums 4 to 7, then sums 8 and 9 in words of two floats.
// The sum for a splat and a block is float number first + place * step, where place is splat * kPlaces + block.
typedef struct {
  int first, step;
} SumPlace;
UBS_FN SumPlace sum_place(int value) {
  SumPlace p;
  p.first = value < 8 ? value / 4 * (4 * kParts) + value % 4 : 8 * kParts + (value - 8);
  p.step = value < 8 ? 4 : 2;
  return p;
}

// Both ways to sum ten values over the 16 lanes of a block use the same tree: they add lanes at a distance of 8, then
// 4, 2 and 1.
#if UBS_SUBGROUPS
// In each step a lane passes on the half of its values that its partner lane keeps, so that 11 exchanges are enough
// instead of 40. At the end, lane l has the sum with the number sum_of_lane(l).
#define UBS_EXCHANGE(low, high, distance) \
  (((lane & distance) != 0 ? high : low) + lane_xor##distance((lane & distance) != 0 ? low : high))
UBS_FN float sum_over_block(const float* v, int lane UBS_EXCHANGE_PARAMETER) {
  float a0 = UBS_EXCHANGE(v[0], v[5], 8), a1 = UBS_EXCHANGE(v[1], v[6], 8), a2 = UBS_EXCHANGE(v[2], v[7], 8);
  float a3 = UBS_EXCHANGE(v[3], v[8], 8), a4 = UBS_EXCHANGE(v[4], v[9], 8);
  float b0 = UBS_EXCHANGE(a0, a3, 4), b1 = UBS_EXCHANGE(a1, a4, 4), b2 = UBS_EXCHANGE(a2, 0.0f, 4);
  float c0 = UBS_EXCHANGE(b0, b2, 2), c1 = UBS_EXCHANGE(b1, 0.0f, 2);
  return UBS_EXCHANGE(c0, c1, 1);
}
// Returns the number of the sum that a lane has, or -1 if it has none.
UBS_FN int sum_of_lane(int lane) {
  int in_third = lane & 3, third = (lane & 4) != 0 ? 3 : 0;
  int holds = third == 0 ? in_third < 3 : in_third < 2;
  return holds ? ((lane & 8) != 0 ? 5 : 0) + third + in_third : -1;
}
#else
// Returns the sum over the lanes of a block. `values` contains one value per lane.
UBS_FN float sum_over_lanes(UBS_LOCAL const float* values) {
  float sums[kLanes / 2];
  UBS_UNROLL for (int l = 0; l < kLanes / 2; ++l) sums[l] = values[l] + values[l + kLanes / 2];
  UBS_UNROLL for (int distance = kLanes / 4; distance > 0; distance /= 2)
    UBS_UNROLL for (int l = 0; l < kLanes / 4; ++l)
      if (l < distance) sums[l] += sums[l + distance];
  return sums[0];
}
#endif

// Examines UBS_BACKWARD_BATCH list entries, starting at `at`. Entries that at least one block composites are stored in
// `shared`, in list order. Returns the number of these entries. The elements of `blocks` after the last of them become
// 0. Without ballot, `kept` must be 0 before the call, and is 0 again afterwards.
UBS_FN int fill_batch(UBS_LOCAL BackwardShared* shared, uint at, uint last, UBS_GLOBAL const float* records,
                      UBS_GLOBAL const uint* sorted_ids, UBS_GLOBAL const uint* sorted_slots,
                      UBS_GLOBAL const ushort* masks, int item) {
  uint slot = 0, mask = 0;
  if (item < UBS_BACKWARD_BATCH && at + (uint)item < last) {
    slot = sorted_slots[at + (uint)item];
    mask = masks[slot];
  }
#if UBS_BALLOT
  if (item < UBS_BACKWARD_BATCH) {  // all lanes of a wave take the same branch
    uint lanes = ballot(mask != 0);
    if (item % 32 == 0) shared->kept[item / 32] = lanes;
  }
#else
  if (mask != 0) ubs_atomic_or(&shared->kept[item / 32], 1u << (item % 32));
#endif
  UBS_BARRIER();
  int count = 0, place = 0;
#ifdef UBS_OPENCL
  UBS_UNROLL
#else
  _Pragma("unroll 1")  // saves six registers in CUDA; in OpenCL on NVIDIA GPUs it would make the kernel 20 % slower
#endif
  for (int word = 0; word < kBackwardWords; ++word) {
    uint bits = shared->kept[word];
    int here = ubs_popcount(bits);
    count += here;
    if (word < item / 32) place += here;
    if (word == item / 32) place += ubs_popcount(bits & ((1u << (item % 32)) - 1u));
  }
  if (mask != 0) {
    SplatRecord record = load_record(records, sorted_ids[at + (uint)item]);
    shared->places[place] = record.place;
    shared->shapes[place] = record.shape;
    shared->colours[place] = record.colour;
#if UBS_ABSGRAD
    shared->ids[place] = sorted_ids[at + (uint)item];
#endif
    shared->slots[place] = slot;
    shared->blocks[place] = mask;
  }
  if (item >= count && item < UBS_BACKWARD_BATCH) shared->blocks[item] = 0;
  UBS_BARRIER();
  turn_blocks(item < UBS_BACKWARD_BATCH ? shared->blocks[item] : 0u, shared->blocks, kBackwardWords, shared->hits, item);
#if !UBS_BALLOT
  if (item < kBackwardWords) shared->kept[item] = 0;
#endif
  UBS_BARRIER();
  return count;
}

// Adds the sums of a turn over the blocks, in their order, and writes the gradient of each splat to its slot. Each
// splat has four consecutive work-items, of which three process four values each.
UBS_FN void write_slots(UBS_LOCAL const BackwardShared* shared, int first, int count, int item,
                        UBS_SLOTS(UBS_GLOBAL float*)) {
  int place = item / 4, part = item % 4, k = first + place;
  if (place >= kTurn || k >= count || part >= kCardSlotStride / 4) return;
  float4 sum = ubs_float4(0.0f, 0.0f, 0.0f, 0.0f);
  for (uint blocks = shared->blocks[k]; blocks != 0; blocks &= blocks - 1) {
    int at = place * kPlaces + lowest_bit32(blocks);
    if (part < 2) {
      float4 four = shared->sums[part * kParts + at];
      sum.x += four.x;
      sum.y += four.y;
      sum.z += four.z;
      sum.w += four.w;
    } else {
      float2 two = ((UBS_LOCAL const float2*)(shared->sums + 2 * kParts))[at];
      sum.x += two.x;
      sum.y += two.y;
    }
  }
  BlendFactors f = blend_factors(blend_splat(shared->places[k], shared->shapes[k], shared->colours[k]));
  if (part == 0)
    sum = ubs_float4(f.xp * sum.x, f.yp * sum.x + f.yq * sum.y, f.square * sum.z, f.square * sum.w);
  else if (part == 1)
    sum = ubs_float4(f.square * sum.x, sum.y, UBS_LN2 * sum.z, sum.w);
  uint slot = shared->slots[k];
  ((UBS_GLOBAL float4*)UBS_SLOT_PIECE(slot))[(ulong)UBS_SLOT_IN_PIECE(slot) * (kCardSlotStride / 4) + (ulong)part] = sum;
}

// With UBS_ABSGRAD, images may have further channels. more_colours (splats, more_channels) are the values of the splats
// in these channels. Plane 0 of v_more (1 + more_channels, rows, pitch) is the dot product of the further channels of
// the image and their gradients, and the other planes are these gradients. The states contain nothing of further
// channels, so if there are any, the work-group of a segment also visits the segments before it, and writes no slots
// for these.
//
// Each block visits those splats of a turn that reach it. If lanes can exchange values, each block advances at its own
// pace. Otherwise all blocks visit their k-th splat at the same time, because the sums go through local memory, and the
// barriers that this requires involve all work-items.
UBS_KERNEL UBS_WAVES UBS_GROUP(kItems) void raster_gpu_backward(
    UBS_GLOBAL const float* records, UBS_GLOBAL const uint* sorted_ids, UBS_GLOBAL const uint* sorted_slots,
    UBS_GLOBAL const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    UBS_GLOBAL const float* image, UBS_GLOBAL const float* v_image, UBS_GLOBAL const ushort* masks,
    UBS_GLOBAL const float* states, UBS_GLOBAL const float* more_colours, UBS_GLOBAL const float* v_more,
    int more_channels, UBS_SLOTS(UBS_GLOBAL float*)) {
  UBS_SHARED BackwardShared shared;
  UBS_EXCHANGE_LOCALS
  int item = ubs_item();
  ListSegment segment = list_segment(tile_ranges, tiles_x * tiles_y, ubs_group_id());
  if (segment.first == segment.last) return;
  TilePixel pixel = tile_pixel(segment.tile, item, tiles_x, tiles_y, width, height);
  float4 state = ubs_float4(pixel.inside ? 1.0f : 0.0f, 0.0f, 0.0f, 0.0f);
  uint from = UBS_ABSGRAD && more_channels > 0 ? tile_ranges[segment.tile] : segment.first;
  if (segment.number > 0 && from == segment.first)
    state = ((UBS_GLOBAL const float4*)states)[(ulong)segment.states * kItems + (ulong)item];

  float v_r = v_image[pixel.index], v_g = v_image[pixel.plane + pixel.index],
        v_b = v_image[2 * pixel.plane + pixel.index];
  float remaining = (image[pixel.index] - state.y) * v_r + (image[pixel.plane + pixel.index] - state.z) * v_g +
                    (image[2 * pixel.plane + pixel.index] - state.w) * v_b;
  if (UBS_ABSGRAD && more_channels > 0) remaining += v_more[pixel.index];
  float open = state.x;

#if !UBS_BALLOT
  if (item < kBackwardWords) shared.kept[item] = 0;
  UBS_BARRIER();
#endif
  for (uint at = from, next; at < segment.last; at = next) {
    uint last = UBS_ABSGRAD && at < segment.first ? segment.first : segment.last;
    next = UBS_ABSGRAD ? ubs_min(at + (uint)UBS_BACKWARD_BATCH, last) : at + (uint)UBS_BACKWARD_BATCH;
    int count = fill_batch(&shared, at, last, records, sorted_ids, sorted_slots, masks, item);
    for (int turn = 0; turn < count; turn += kTurn) {
      // Bit k of `bits` is set if the block visits splat k of this turn.
      int word = turn / 32;
      uint shift = (uint)turn % 32, of_turn = 0xffffffffu >> (32 - kTurn);
      uint bits = shared.hits[pixel.block * kBackwardWords + word] >> shift & of_turn;
#if UBS_SUBGROUPS
      SumPlace mine = sum_place(sum_of_lane(pixel.lane));
      int holds = sum_of_lane(pixel.lane) >= 0;
      while (any_of_wave(bits != 0)) {
#else
      int rounds = 0;
      for (int i = 0; i < kBlocks; ++i)
        rounds = max(rounds, ubs_popcount(shared.hits[i * kBackwardWords + word] >> shift & of_turn));
      for (; rounds > 0; --rounds) {
#endif
        int active = bits != 0;
        int k = active ? lowest_bit32(bits) : 0;
        bits &= bits - 1;
        float4 place = shared.places[turn + k];
        BlendSplat s = blend_splat(place, shared.shapes[turn + k], shared.colours[turn + k]);
        BlendAlpha a = blend_alpha(s, place.x - pixel.x, place.y - pixel.y);
        BlendStep step = blend_step(a, open);
        float shade = blend_shade(s, v_r, v_g, v_b);
#if UBS_ABSGRAD
        UBS_GLOBAL const float* colours = more_colours + (ulong)shared.ids[turn + k] * (ulong)more_channels;
        UBS_GLOBAL const float* v_channel = v_more + pixel.index;
#ifndef UBS_OPENCL
        _Pragma("unroll 1")  // in CUDA, registers would be spilled otherwise
#endif
        for (int c = 0; c < more_channels; ++c) shade += colours[c] * *(v_channel += pixel.plane);
#endif
        float left = blend_remaining(step, remaining, shade);
        BlendSums v = blend_vjp(blend_no_sums(), s, a, step, open, left, shade, v_r, v_g, v_b);
        remaining = active ? left : remaining;
        open = active ? step.open : open;
        const float all[kSums] = {v.hp, v.hq, v.hpp, v.hpq, v.hqq, v.opacity, v.log_beta, v.r, v.g, v.b};
        int to = k * kPlaces + pixel.block;
#if UBS_SUBGROUPS
        float sum = sum_over_block(all, pixel.lane UBS_EXCHANGE_ARGUMENT);
        if (active && holds) ((UBS_LOCAL float*)shared.sums)[mine.first + to * mine.step] = sum;
#else
        if (pixel.lane == 0) shared.places_now[pixel.block] = active ? to : -1;
        UBS_UNROLL for (int i = 0; i < kSums; ++i)
          shared.values[(i * kBlocks + pixel.block) * (kLanes + 1) + pixel.lane] = all[i];
        UBS_BARRIER();
        if (item < kSums * kBlocks && shared.places_now[item % kBlocks] >= 0) {
          SumPlace mine = sum_place(item / kBlocks);
          ((UBS_LOCAL float*)shared.sums)[mine.first + shared.places_now[item % kBlocks] * mine.step] =
              sum_over_lanes(shared.values + item * (kLanes + 1));
        }
        UBS_BARRIER();
#endif
      }
      UBS_BARRIER();
      if (!UBS_ABSGRAD || at >= segment.first) write_slots(&shared, turn, count, item, UBS_SLOT_ARGUMENTS);
      UBS_BARRIER();
    }
  }
}
