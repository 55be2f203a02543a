// SPDX-License-Identifier: Apache-2.0
// This file contains the forward rasteriser for GPUs. The splats of a tile's list are loaded into local memory in
// batches. A batch has as many splats as the tile has pixels. Long lists are rendered in parts (list_parts.h).

// Number of splats whose alphas a work-item computes before it blends the first of them, so that the computations of
// their alphas need not wait for each other (docs/results/2026-11-26-h200-lists.md).
#ifndef UBS_TOGETHER
#define UBS_TOGETHER 1
#endif

enum {
  kForwardWords = kItems / 32,
  kVotes = UBS_BALLOT ? kItems / 32 : 1,
};

// Returns the blocks that the splat reaches as a bit mask. Bit b is set if the splat reaches block b of the tile whose
// upper left corner is (left, top).
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

// Returns a pointer to the state of a pixel in front of a segment (list_segments.h).
UBS_FN UBS_GLOBAL float4* state_of(UBS_GLOBAL float* states, uint list_first, uint segment, int item) {
  return (UBS_GLOBAL float4*)states + ((ulong)list_states(list_first, segment) * kItems + (ulong)item);
}

typedef struct {
  float4 places[kItems], shapes[kItems];
  uint blocks[UBS_BALLOT ? 4 : kItems];  // the blocks that each splat reaches; not used with ballot
  float2 colours[kItems];
#if UBS_DEPTH
  float depths[kItems];
#endif
  uint hits[kBlocks * kForwardWords];
  // Bit masks of the blocks that have an open pixel, for this batch and for the next one.
  uint votes[2][kVotes];
} ForwardShared;

// Records in `votes` which blocks have an open pixel. The result is complete after a barrier. Without ballot the votes
// must be 0 before the call.
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
// Returns the bit mask of the blocks that have an open pixel.
UBS_FN uint open_blocks(UBS_LOCAL const uint* votes) {
  uint blocks = votes[0];
  UBS_UNROLL for (int i = 1; i < kVotes; ++i) blocks |= votes[i];
  return blocks;
}

// ForwardPixel is the state of a pixel after the first entries of its list have been blended.
typedef struct {
  float open;              // transmittance if the pixel is still open, otherwise 0
  float rest;              // transmittance after the last composited splat
  float r, g, b;
  float weighted_depth, weight;  // sums for the expected depth; only used with UBS_DEPTH
} ForwardPixel;

UBS_FN ForwardPixel new_pixel(float open) {
  ForwardPixel p = {open, open, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
  return p;
}

// Blends the entries from `begin` to `end` - 1 of a list that starts at `first`. masks and states are null if there is
// no backward pass.
UBS_FN ForwardPixel take_entries(ForwardPixel p, UBS_LOCAL ForwardShared* shared, TilePixel pixel, int item, uint first,
                                 uint begin, uint end, UBS_GLOBAL const float* records,
                                 UBS_GLOBAL const uint* sorted_ids, UBS_GLOBAL const uint* sorted_slots,
                                 UBS_GLOBAL ushort* masks, UBS_GLOBAL float* states) {
  int keeps = !UBS_FORWARD_ONLY && masks != 0;
#if !UBS_BALLOT
  if (item == 0) shared->votes[0][0] = 0;
  UBS_BARRIER();
#endif
  uint at = begin;
  for (int turn = 0; at < end; at += kItems, turn ^= 1) {
    vote_open(shared->votes[turn], p.open > 0.0f, pixel, item);
    UBS_BARRIER();  // also ensures that the previous batch is no longer read
    uint alive = open_blocks(shared->votes[turn]);
    if (alive == 0) break;  // all work-items of the group take the same branch
    if (keeps && at != first && (at - first) % kListSegment == 0)
      *state_of(states, first, (at - first) / kListSegment, item) = ubs_float4(p.open, p.r, p.g, p.b);
    uint blocks = 0;
    if (at + (uint)item < end) {
      SplatRecord record = load_record(records, sorted_ids[at + (uint)item]);
      shared->places[item] = record.place;
      shared->shapes[item] = record.shape;
      shared->colours[item] = record.colour;
#if UBS_DEPTH
      shared->depths[item] = record.depth;
#endif
      blocks = reached_blocks(record, (float)pixel.left, (float)pixel.top) & alive;
      if (keeps) masks[sorted_slots[at + (uint)item]] = (ushort)blocks;
    }
#if !UBS_BALLOT
    if (item == 0) shared->votes[turn ^ 1][0] = 0;
    shared->blocks[item] = blocks;
    UBS_BARRIER();
#endif
    turn_blocks(blocks, shared->blocks, kForwardWords, shared->hits, item);
    UBS_BARRIER();
    for (int word = 0; word < kForwardWords; ++word) {
      uint bits = shared->hits[pixel.block * kForwardWords + word];
      while (bits != 0 && p.open > 0.0f) {
        int k[UBS_TOGETHER];
        BlendSplat s[UBS_TOGETHER];
        BlendAlpha a[UBS_TOGETHER];
        UBS_UNROLL for (int i = 0; i < UBS_TOGETHER; ++i) {
          int exists = i == 0 || bits != 0;
          k[i] = exists ? word * 32 + lowest_bit32(bits) : k[0];
          bits &= bits - 1;
          float4 place = shared->places[k[i]];
          s[i] = blend_splat(place, shared->shapes[k[i]], shared->colours[k[i]]);
          a[i] = blend_alpha(s[i], place.x - pixel.x, place.y - pixel.y);
          if (!exists) a[i].alpha = 0.0f;
        }
        UBS_UNROLL for (int i = 0; i < UBS_TOGETHER; ++i) {
          BlendStep step = blend_step(a[i], p.open);
          p.open = step.open;
          p.rest = step.composited ? step.open : p.rest;
          p.r += step.weight * s[i].r;
          p.g += step.weight * s[i].g;
          p.b += step.weight * s[i].b;
#if UBS_DEPTH
          p.weighted_depth += step.weight * shared->depths[k[i]];
          p.weight += step.weight;
#endif
        }
      }
    }
  }
  if (keeps) {
    for (uint k = at + (uint)item; k < end; k += kItems) masks[sorted_slots[k]] = 0;
    uint next = (at - first + kListSegment - 1) / kListSegment;
    for (uint segment = next > 0 ? next : 1; segment * kListSegment < end - first; ++segment)
      *state_of(states, first, segment, item) = ubs_float4(0.0f, 0.0f, 0.0f, 0.0f);
  }
  return p;
}

UBS_FN void put_pixel(ForwardPixel p, TilePixel pixel, float background_r, float background_g, float background_b,
                      UBS_GLOBAL float* image, UBS_GLOBAL float* transmittance, UBS_GLOBAL float* depth) {
  image[pixel.index] = p.r + p.rest * background_r;
  image[pixel.plane + pixel.index] = p.g + p.rest * background_g;
  image[2 * pixel.plane + pixel.index] = p.b + p.rest * background_b;
  transmittance[pixel.index] = p.rest;
  if (UBS_DEPTH) depth[pixel.index] = blend_expected_depth(p.weighted_depth, p.weight);
}

// Returns the index in `parts` of the first value of a pixel of a part. Each part has kPartPlanes planes of one float
// per pixel. Plane 0 is the transmittance of the part. Plane 1 is the transmittance after the part; it is negative if
// the pixel finishes in the part, and 0 if the pixel was finished before. Planes 2 to 4 are the colour, and planes 5
// and 6 the depth sums.
UBS_FN ulong part_place(ListPart part, int item) { return (ulong)part.place * (kPartPlanes * kItems) + (ulong)item; }

// First pass of long lists: computes the transmittance of each part except the last. long_lists points to 0 if no list
// is long.
UBS_KERNEL UBS_GROUP(kItems) void raster_gpu_parts(
    UBS_GLOBAL const float* records, UBS_GLOBAL const uint* sorted_ids, UBS_GLOBAL const uint* tile_ranges, int tiles_x,
    int tiles_y, int width, int height, UBS_GLOBAL const uint* long_lists, UBS_GLOBAL float* parts) {
  UBS_SHARED ForwardShared shared;
  if (*long_lists == 0) return;
  int item = ubs_local_id();
  ListPart part = list_part(tile_ranges, tiles_x * tiles_y, ubs_group_id());
  if (part.number + 1 >= part.count) return;
  TilePixel pixel = tile_pixel(part.tile, item, tiles_x, tiles_y, width, height);
  ForwardPixel p = take_entries(new_pixel(pixel.inside ? 1.0f : 0.0f), &shared, pixel, item, part.list, part.first,
                                part.last, records, sorted_ids, sorted_ids, 0, 0);
  parts[part_place(part, item)] = p.open;
}

// Renders the tiles, and computes the colours of the parts of long lists (their second pass). The work-groups with
// numbers below the number of tiles process short lists and the first parts of long lists; the others process the
// further parts of long lists. `masks` and `states` are null if there is no backward pass. `parts` is null if long
// lists are not divided.
UBS_KERNEL UBS_GROUP(kItems) void raster_gpu_forward(
    UBS_GLOBAL const float* records, UBS_GLOBAL const uint* sorted_ids, UBS_GLOBAL const uint* sorted_slots,
    UBS_GLOBAL const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height, float background_r,
    float background_g, float background_b, UBS_GLOBAL float* image, UBS_GLOBAL float* transmittance,
    UBS_GLOBAL float* depth, UBS_GLOBAL ushort* masks, UBS_GLOBAL float* states, UBS_GLOBAL const uint* long_lists,
    UBS_GLOBAL float* parts) {
  UBS_SHARED ForwardShared shared;
  int item = ubs_local_id(), tiles = tiles_x * tiles_y;
  int divides = parts != 0 && *long_lists != 0;
  uint group = ubs_group_id();
  if (group >= (uint)tiles && !divides) return;
  ListPart part = group < (uint)tiles ? part_of_list(tile_ranges, (int)group, 0, divides)
                                      : list_part(tile_ranges, tiles, group - (uint)tiles);
  if (group >= (uint)tiles && (part.number == 0 || part.number >= part.count)) return;
  TilePixel pixel = tile_pixel(part.tile, item, tiles_x, tiles_y, width, height);
  float open = pixel.inside ? 1.0f : 0.0f;
  ListPart before = part;
  for (before.place = part.place - part.number; before.place < part.place; ++before.place)
    open *= parts[part_place(before, item)];
  if (open <= UBS_TRANSMITTANCE_MIN) open = 0.0f;
  ForwardPixel p = take_entries(new_pixel(open), &shared, pixel, item, part.list, part.first, part.last, records,
                                sorted_ids, sorted_slots, masks, states);
  if (part.count == 1) {
    put_pixel(p, pixel, background_r, background_g, background_b, image, transmittance, depth);
    return;
  }
  UBS_GLOBAL float* to = parts + part_place(part, item);
  to[kItems] = p.open > 0.0f ? p.rest : -p.rest;
  to[2 * kItems] = p.r;
  to[3 * kItems] = p.g;
  to[4 * kItems] = p.b;
#if UBS_DEPTH
  to[5 * kItems] = p.weighted_depth;
  to[6 * kItems] = p.weight;
#endif
}

// Last pass of long lists: adds the results of a tile's parts in their order, and adds the colour in front of a part to
// the states of its segments. Once a part has finished a pixel, later parts do not count, even if rounding has left the
// product of transmittances just above the threshold.
UBS_KERNEL UBS_GROUP(kItems) void raster_gpu_join(
    UBS_GLOBAL const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height, float background_r,
    float background_g, float background_b, UBS_GLOBAL float* image, UBS_GLOBAL float* transmittance,
    UBS_GLOBAL float* depth, UBS_GLOBAL float* states, UBS_GLOBAL const uint* long_lists,
    UBS_GLOBAL const float* parts) {
  if (*long_lists == 0) return;
  int item = ubs_local_id();
  ListPart part = part_of_list(tile_ranges, (int)ubs_group_id(), 0, 1);
  if (part.count == 1) return;
  TilePixel pixel = tile_pixel(part.tile, item, tiles_x, tiles_y, width, height);
  uint entries = tile_ranges[part.tile + 1] - part.list;
  ForwardPixel sum = new_pixel(1.0f);
  for (; part.number < part.count; ++part.number, ++part.place) {
    if (!UBS_FORWARD_ONLY && states != 0 && part.number > 0) {
      uint segment = part.number * (kListPart / kListSegment);
      for (uint k = segment; k < segment + kListPart / kListSegment && k * kListSegment < entries; ++k) {
        UBS_GLOBAL float4* state = state_of(states, part.list, k, item);
        float4 s = *state;
        *state = sum.open > 0.0f ? ubs_float4(s.x, s.y + sum.r, s.z + sum.g, s.w + sum.b)
                                 : ubs_float4(0.0f, 0.0f, 0.0f, 0.0f);
      }
    }
    UBS_GLOBAL const float* from = parts + part_place(part, item);
    float rest = from[kItems];
    if (sum.open == 0.0f) continue;
    if (rest != 0.0f) sum.rest = rest > 0.0f ? rest : -rest;
    if (rest <= 0.0f) sum.open = 0.0f;
    sum.r += from[2 * kItems];
    sum.g += from[3 * kItems];
    sum.b += from[4 * kItems];
#if UBS_DEPTH
    sum.weighted_depth += from[5 * kItems];
    sum.weight += from[6 * kItems];
#endif
  }
  put_pixel(sum, pixel, background_r, background_g, background_b, image, transmittance, depth);
}
