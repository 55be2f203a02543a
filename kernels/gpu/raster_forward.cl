// SPDX-License-Identifier: Apache-2.0
// Forward rasteriser for GPUs. Splats of the tile's list pass through local memory, one batch of as many as there are
// pixels after the other.

// Splats whose alphas a work-item computes, none waiting for another, before it blends them
// (docs/results/2026-11-26-h200-lists.md).
#ifndef UBS_TOGETHER
#define UBS_TOGETHER 1
#endif

enum {
  kForwardWords = kItems / 32,
  kVotes = UBS_BALLOT ? kItems / 32 : 1,
};

// Bit b: the splat reaches block b of the tile whose corner is (left, top).
UBS_FN uint reached_blocks(SplatRecord r, float left, float top) {
  CullSplat s = cull_splat(r.place.x - left, r.place.y - top, r.place.z, r.place.w, r.shape.x, r.reach);
  uint blocks = 0;
  UBS_UNROLL for (int by = 0; by < kBlocksX; ++by) {
    CullSpan down = cull_span(s.y, (float)(by * kBlock + kBlock / 2));
    UBS_UNROLL for (int bx = 0; bx < kBlocksX; ++bx)
      if (cull_meets(s, cull_span(s.x, (float)(bx * kBlock + kBlock / 2)), down))
        blocks |= 1u << (by * kBlocksX + bx);
  }
  return blocks;
}

UBS_FN void put_state(UBS_GLOBAL float* states, uint list_first, uint segment, int item, float4 state) {
  ((UBS_GLOBAL float4*)states)[(ulong)list_states(list_first, segment) * kItems + (ulong)item] = state;
}

typedef struct {
  float4 places[kItems], shapes[kItems];
  uint blocks[UBS_BALLOT ? 4 : kItems];  // that splats reach
  float2 colours[kItems];
#if UBS_DEPTH
  float depths[kItems];
#endif
  uint hits[kBlocks * kForwardWords];
  uint votes[2][kVotes];  // for the blocks with an open pixel, of this batch and the next
} ForwardShared;

// The blocks with a pixel that is open, after a barrier. Without ballot the votes must be 0 before.
UBS_FN void vote_open(UBS_LOCAL uint* votes, int open, TilePixel pixel, int item) {
#if UBS_BALLOT
  (void)pixel;
  uint lanes = ballot(open);
  uint pair = ((lanes & 0xffffu) != 0 ? 1u : 0u) | ((lanes >> kLanes) != 0 ? 2u : 0u);
  if (item % 32 == 0) votes[item / 32] = pair << (item / kLanes);
#else
  (void)item;
  if (open) ubs_atomic_or(votes, 1u << pixel.block);
#endif
}
UBS_FN uint open_blocks(UBS_LOCAL const uint* votes) {
  uint blocks = votes[0];
  UBS_UNROLL for (int i = 1; i < kVotes; ++i) blocks |= votes[i];
  return blocks;
}

// masks and states: null where nobody goes backward.
UBS_KERNEL UBS_GROUP(kItems) void raster_gpu_forward(
    UBS_GLOBAL const float* records, UBS_GLOBAL const uint* sorted_ids, UBS_GLOBAL const uint* sorted_slots,
    UBS_GLOBAL const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height, float background_r,
    float background_g, float background_b, UBS_GLOBAL float* image, UBS_GLOBAL float* transmittance,
    UBS_GLOBAL float* depth, UBS_GLOBAL ushort* masks, UBS_GLOBAL float* states) {
  UBS_SHARED ForwardShared shared;
  int item = ubs_local_id(), tile = (int)ubs_group_id();
  TilePixel pixel = tile_pixel(tile, item, tiles_x, tiles_y, width, height);
  uint first = tile_ranges[tile], last = tile_ranges[tile + 1];
  int keeps = !UBS_FORWARD_ONLY && masks != 0;

  float open = pixel.inside ? 1.0f : 0.0f;
  float rest = 1.0f, r = 0.0f, g = 0.0f, b = 0.0f;
  float weighted_depth = 0.0f, weight = 0.0f;  // with UBS_DEPTH
#if !UBS_BALLOT
  if (item == 0) shared.votes[0][0] = 0;
  UBS_BARRIER();
#endif
  uint at = first;
  for (int turn = 0; at < last; at += kItems, turn ^= 1) {
    vote_open(shared.votes[turn], open > 0.0f, pixel, item);
    UBS_BARRIER();  // also: nobody reads the splats of the last batch any more
    uint alive = open_blocks(shared.votes[turn]);
    if (alive == 0) break;  // the same for the whole group
    if (keeps && at != first && (at - first) % kListSegment == 0)
      put_state(states, first, (at - first) / kListSegment, item, ubs_float4(open, r, g, b));
    uint blocks = 0;
    if (at + (uint)item < last) {
      SplatRecord record = load_record(records, sorted_ids[at + (uint)item]);
      shared.places[item] = record.place;
      shared.shapes[item] = record.shape;
      shared.colours[item] = record.colour;
#if UBS_DEPTH
      shared.depths[item] = record.depth;
#endif
      blocks = reached_blocks(record, (float)pixel.left, (float)pixel.top) & alive;
      if (keeps) masks[sorted_slots[at + (uint)item]] = (ushort)blocks;
    }
#if !UBS_BALLOT
    if (item == 0) shared.votes[turn ^ 1][0] = 0;
    shared.blocks[item] = blocks;
    UBS_BARRIER();
#endif
    turn_blocks(blocks, shared.blocks, kForwardWords, shared.hits, item);
    UBS_BARRIER();
    for (int word = 0; word < kForwardWords; ++word) {
      uint bits = shared.hits[pixel.block * kForwardWords + word];
      while (bits != 0 && open > 0.0f) {
        int k[UBS_TOGETHER];
        BlendSplat s[UBS_TOGETHER];
        BlendAlpha a[UBS_TOGETHER];
        UBS_UNROLL for (int i = 0; i < UBS_TOGETHER; ++i) {
          int exists = i == 0 || bits != 0;
          k[i] = exists ? word * 32 + lowest_bit32(bits) : k[0];
          bits &= bits - 1;
          float4 place = shared.places[k[i]];
          s[i] = blend_splat(place, shared.shapes[k[i]], shared.colours[k[i]]);
          a[i] = blend_alpha(s[i], place.x - pixel.x, place.y - pixel.y);
          if (!exists) a[i].alpha = 0.0f;
        }
        UBS_UNROLL for (int i = 0; i < UBS_TOGETHER; ++i) {
          BlendStep step = blend_step(a[i], open);
          open = step.open;
          rest = step.composited ? step.open : rest;
          r += step.weight * s[i].r;
          g += step.weight * s[i].g;
          b += step.weight * s[i].b;
#if UBS_DEPTH
          weighted_depth += step.weight * shared.depths[k[i]];
          weight += step.weight;
#endif
        }
      }
    }
  }
  if (keeps) {
    for (uint k = at + (uint)item; k < last; k += kItems) masks[sorted_slots[k]] = 0;
    for (uint segment = (at - first + kListSegment - 1) / kListSegment; segment * kListSegment < last - first; ++segment)
      put_state(states, first, segment, item, ubs_float4(0.0f, 0.0f, 0.0f, 0.0f));
  }

  image[pixel.index] = r + rest * background_r;
  image[pixel.plane + pixel.index] = g + rest * background_g;
  image[2 * pixel.plane + pixel.index] = b + rest * background_b;
  transmittance[pixel.index] = rest;
  if (UBS_DEPTH) depth[pixel.index] = blend_expected_depth(weighted_depth, weight);
}
