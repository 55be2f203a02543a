// SPDX-License-Identifier: Apache-2.0
// Rasteriser for CPUs. One work-item processes one tile of 16x16 pixels, without barriers. Pixels are processed in
// blocks of 4x4 as vectors of UBS_VW lanes (16 / UBS_VW parts per block), and splats in chunks of 64. For each chunk,
// each block gets the set of splats whose ellipse reaches it as one 64-bit word, and then blends only these. The
// forward pass also stores which open blocks of the tile a splat reaches; the backward pass visits only these. Loops
// over parts have UBS_UNROLL, because otherwise visits are copied by calls of memcpy, which takes twice the time on 8
// lanes. docs/performance.md describes the structure and its measurements.

enum {
  kBlock = 4,
  kBlocksX = kTileSide / kBlock,
  kBlocks = kBlocksX * kBlocksX,
  kParts = kBlock * kBlock / UBS_VW,
};
// Tuned constants (host/opencl/opencl_tuning.cpp). A chunk consists of whole vectors, and has at most the 64 splats
// that fit into a word.
#ifndef UBS_CHUNK
#define UBS_CHUNK 64
#endif
// The backward pass prefetches the cache lines of the splat that is this many entries ahead.
#ifndef UBS_PREFETCH_DISTANCE
#define UBS_PREFETCH_DISTANCE 12
#endif

// The order of the tiles. By default PoCL gives each thread runs of consecutive work-groups, and the first run is a
// quarter to a half of all. Therefore the tiles are scattered over the groups, so that no run is the expensive middle
// of the image (10 % less time for 200x200). If cores choose their groups themselves (opencl/core_groups.h), each core
// has rows of the image and starts in the middle of the image, so that cheap tiles remain at the end to balance the
// load.
#ifndef UBS_SCATTER
#define UBS_SCATTER 31  // a prime; or 1 for rows of tiles, starting in the middle
#endif
UBS_FN int tile_of_group(uint group, uint tiles) {
#if UBS_SCATTER == 1
  return (int)(group < tiles / 2 ? tiles / 2 - 1 - group : group);
#else
  return (int)(tiles % UBS_SCATTER == 0 ? group : group * (uint)UBS_SCATTER % tiles);
#endif
}

// Returns the centre of a column or row of blocks relative to the tile's corner.
UBS_FN float block_centre(int i) { return (float)(i * kBlock) + 0.5f * kBlock; }

// Return the pixel centres of part `part` of a block, relative to the block's corner.
UBS_FN vreal part_x(int part) {
  float x[UBS_VW];
  for (int lane = 0; lane < UBS_VW; ++lane) x[lane] = (float)((part * UBS_VW + lane) % kBlock) + 0.5f;
  return UBS_LOAD(x);
}
UBS_FN vreal part_y(int part) {
  float y[UBS_VW];
  for (int lane = 0; lane < UBS_VW; ++lane) y[lane] = (float)((part * UBS_VW + lane) / kBlock) + 0.5f;
  return UBS_LOAD(y);
}

// Pixel centres of a tile's block columns and rows. Both passes use the same table, because backward must compute
// alphas that are bit-identical to those of forward.
typedef struct {
  vreal x[kBlocksX][kParts], y[kBlocksX][kParts];
} Centres;

UBS_FN void make_centres(Centres* centres, int left, int top) {
  for (int i = 0; i < kBlocksX; ++i) {
    for (int part = 0; part < kParts; ++part) {
      centres->x[i][part] = part_x(part) + (float)(left + i * kBlock);
      centres->y[i][part] = part_y(part) + (float)(top + i * kBlock);
    }
  }
}

UBS_FN void store_block(const vreal* parts, __global float* plane, int pitch) {
  float pixels[kBlock * kBlock];
  for (int part = 0; part < kParts; ++part) UBS_STORE(parts[part], pixels + part * UBS_VW);
  for (int row = 0; row < kBlock; ++row) vstore4(vload4(row, pixels), 0, plane + row * pitch);
}

UBS_FN void load_block(vreal* parts, __global const float* plane, int pitch) {
  float pixels[kBlock * kBlock];
  for (int row = 0; row < kBlock; ++row) vstore4(vload4(0, plane + row * pitch), row, pixels);
  for (int part = 0; part < kParts; ++part) parts[part] = UBS_LOAD(pixels + part * UBS_VW);
}

// Returns 1 for pixels of the image, and 0 for those of the padding, which are closed from the start.
UBS_FN vreal initial_open(int part, int left, int top, int width, int height) {
  vreal x = part_x(part) + (float)left;
  vreal y = part_y(part) + (float)top;
  return ((x < (vreal)((float)width)) & (y < (vreal)((float)height))) ? V(1.0) : V(0.0);
}

UBS_FN BlendSplat load_blend_splat(__global const float* record) {
  BlendSplat s;
  s.l00 = record[kSplatL00];
  s.l01 = record[kSplatL01];
  s.l11 = record[kSplatL11];
  s.opacity = record[kSplatOpacity];
  s.beta = record[kSplatBeta];
  s.r = record[kSplatR];
  s.g = record[kSplatG];
  s.b = record[kSplatB];
  return s;
}

// One chunk of a tile's splats, and the words of the blocks.
typedef struct {
  __global const float* lines[UBS_CHUNK];  // records
  vreal x[UBS_CHUNK / UBS_VW], y[UBS_CHUNK / UBS_VW];
  vreal l00[UBS_CHUNK / UBS_VW], l01[UBS_CHUNK / UBS_VW], l11[UBS_CHUNK / UBS_VW];
  vreal reach[UBS_CHUNK / UBS_VW];   // with UBS_OPACITY_EXTENTS
  vmask blocks[UBS_CHUNK / UBS_VW];  // per splat: bit b is set if it reaches block b
  ulong hits[kBlocks];               // per block: bit k is set if splat k reaches it
} Chunk;

// Loads the records of a chunk, and prefetches those of the next chunk. The remaining lanes of the last vector are
// filled with a splat that reaches nothing.
UBS_FN void gather_chunk(Chunk* chunk, __global const float* records, __global const uint* ids, int count,
                         int ahead, float left, float top) {
  for (int k = 0; k < count; ++k) {
    __global const float* record = records + (ulong)ids[k] * kSplatStride;
    chunk->lines[k] = record;
    ((float*)chunk->x)[k] = record[kSplatX] - left;
    ((float*)chunk->y)[k] = record[kSplatY] - top;
    ((float*)chunk->l00)[k] = record[kSplatL00];
    ((float*)chunk->l01)[k] = record[kSplatL01];
    ((float*)chunk->l11)[k] = record[kSplatL11];
    if (UBS_OPACITY_EXTENTS) ((float*)chunk->reach)[k] = record[kSplatReach];
    if (k < ahead) UBS_PREFETCH(records + (ulong)ids[k + UBS_CHUNK] * kSplatStride);
  }
  for (int k = count; k % UBS_VW != 0; ++k) {
    ((float*)chunk->x)[k] = ((float*)chunk->y)[k] = 1e9f;
    ((float*)chunk->l00)[k] = ((float*)chunk->l11)[k] = 1.0f;
    ((float*)chunk->l01)[k] = 0.0f;
    if (UBS_OPACITY_EXTENTS) ((float*)chunk->reach)[k] = 0.0f;
  }
}

// Determines which blocks the splats of a chunk reach. This takes 15 vector instructions for 16 splats and one block.
// 1.5 % of the visits then have no effect (with the bounding boxes of the footprints: 40 %).
UBS_FN void cull_chunk(Chunk* chunk, int count) {
  for (int block = 0; block < kBlocks; ++block) chunk->hits[block] = 0;
  for (int group = 0; group * UBS_VW < count; ++group) {
    vreal reach = UBS_OPACITY_EXTENTS ? chunk->reach[group] : (vreal)(UBS_SUPPORT);
    CullSplat s = cull_splat(chunk->x[group], chunk->y[group], chunk->l00[group], chunk->l01[group],
                             chunk->l11[group], reach);
    vmask blocks = (vmask)(0);
    CullSpan across[kBlocksX];
    for (int bx = 0; bx < kBlocksX; ++bx) across[bx] = cull_span(s.x, block_centre(bx));
    for (int by = 0; by < kBlocksX; ++by) {
      CullSpan down = cull_span(s.y, block_centre(by));
      for (int bx = 0; bx < kBlocksX; ++bx) {
        int block = by * kBlocksX + bx;
        vmask meets = cull_meets(s, across[bx], down);
        blocks |= meets ? (vmask)(1 << block) : (vmask)(0);
        chunk->hits[block] |= (ulong)lane_bits(meets) << (group * UBS_VW);
      }
    }
    chunk->blocks[group] = blocks;
  }
}

// The visit of a splat to the pixels of a block: blend_begin() has been called, blend_end() has not.
typedef struct {
  __global const float* record;
  BlendAlpha alpha[kParts];
} Visit;

// The record is read again for each block. If its values were kept as vectors during a loop, they would displace sums
// from the registers.
UBS_FN Visit begin_visit(__global const float* record, const vreal* x, const vreal* y) {
  Visit visit;
  visit.record = record;
  UBS_UNROLL for (int part = 0; part < kParts; ++part)
    visit.alpha[part] =
        blend_begin(load_blend_splat(record), record[kSplatX] - x[part], record[kSplatY] - y[part]);
  return visit;
}

// State of a block's pixels while splats are blended.
typedef struct {
  vreal open[kParts];  // transmittance while the pixel is open, 0 afterwards
  vreal left[kParts];  // transmittance
  vreal r[kParts], g[kParts], b[kParts];
  vreal depth[kParts], weight[kParts];  // with UBS_DEPTH
} PixelBlock;

UBS_FN void blend_visit(PixelBlock* pixels, Visit visit) {
  BlendSplat s = load_blend_splat(visit.record);
  UBS_UNROLL for (int part = 0; part < kParts; ++part) {
    BlendStep step = blend_step(blend_end(s, visit.alpha[part]), pixels->open[part]);
    pixels->r[part] += step.weight * s.r;
    pixels->g[part] += step.weight * s.g;
    pixels->b[part] += step.weight * s.b;
    pixels->left[part] = step.composited ? step.open : pixels->left[part];
    pixels->open[part] = step.open;
    if (UBS_DEPTH) {
      pixels->depth[part] += step.weight * visit.record[kSplatDepth];
      pixels->weight[part] += step.weight;
    }
  }
}

// Blends those splats of the chunk that reach a block (at least one). Returns whether any pixel of the block is still
// open. This is tested once per chunk, because a test per splat would make the loop wait for each result (three times
// slower), and a closed block only wastes the rest of its chunk.
// Each visit starts before the previous one is finished. Then the logarithm of one splat and the power of the other do
// not wait for each other; each is a chain about as long as the CPU can look ahead (15 % less time).
UBS_FN int blend_block(PixelBlock* block_pixels, const Chunk* chunk, const Centres* centres, int block) {
  PixelBlock pixels = *block_pixels;
  const vreal *x = centres->x[block % kBlocksX], *y = centres->y[block / kBlocksX];
  ulong hits = chunk->hits[block];
  Visit visit = begin_visit(chunk->lines[lowest_bit(hits)], x, y);
  for (hits &= hits - 1; hits != 0; hits &= hits - 1) {
    Visit next = begin_visit(chunk->lines[lowest_bit(hits)], x, y);
    blend_visit(&pixels, visit);
    visit = next;
  }
  blend_visit(&pixels, visit);
  *block_pixels = pixels;
  vmask going = (vmask)(0);
  UBS_UNROLL for (int part = 0; part < kParts; ++part) going |= pixels.open[part] > V(0.0);
  return ubs_any_lane(going);
}

// The tile of a work-item: its corner, and the place of its list.
typedef struct {
  int left, top, width, height;  // corner of the tile, size of the image [px]
  int pitch, plane;
  uint first, last;
} Tile;

UBS_FN Tile find_tile(uint group, __global const uint* tile_ranges, int tiles_x, int tiles_y, int width,
                      int height) {
  int index = tile_of_group(group, (uint)(tiles_x * tiles_y));
  Tile tile;
  tile.left = index % tiles_x * kTileSide;
  tile.top = index / tiles_x * kTileSide;
  tile.width = width;
  tile.height = height;
  tile.pitch = tiles_x * kTileSide;
  tile.plane = tile.pitch * tiles_y * kTileSide;
  tile.first = tile_ranges[index];
  tile.last = tile_ranges[index + 1];
  return tile;
}
UBS_FN int block_left(Tile tile, int block) { return tile.left + block % kBlocksX * kBlock; }
UBS_FN int block_top(Tile tile, int block) { return tile.top + block / kBlocksX * kBlock; }
UBS_FN int block_corner(Tile tile, int block) {
  return block_top(tile, block) * tile.pitch + block_left(tile, block);
}

// Initialises the pixels. Returns the bits of the blocks that contain pixels of the image.
UBS_FN uint start_pixels(PixelBlock* pixels, Tile tile) {
  uint alive = 0;
  for (int block = 0; block < kBlocks; ++block) {
    int left = block_left(tile, block), top = block_top(tile, block);
    if (left < tile.width && top < tile.height) alive |= 1u << block;
    for (int part = 0; part < kParts; ++part) {
      pixels[block].open[part] = initial_open(part, left, top, tile.width, tile.height);
      pixels[block].left[part] = V(1.0);
      pixels[block].r[part] = pixels[block].g[part] = pixels[block].b[part] = V(0.0);
      if (UBS_DEPTH) pixels[block].depth[part] = pixels[block].weight[part] = V(0.0);
    }
  }
  return alive;
}

UBS_FN void store_colour(const vreal* colour, const vreal* left, float background, __global float* plane,
                         int pitch) {
  vreal pixels[kParts];
  for (int part = 0; part < kParts; ++part) pixels[part] = colour[part] + left[part] * background;
  store_block(pixels, plane, pitch);
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void raster_cpu_forward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height, float background_r,
    float background_g, float background_b, __global float* image, __global float* transmittance,
    __global float* depth, __global ushort* masks UBS_CORE_PARAMETERS) {
  Tile tile = find_tile(UBS_CORE_GROUP, tile_ranges, tiles_x, tiles_y, width, height);
  PixelBlock pixels[kBlocks];
  uint alive = start_pixels(pixels, tile);
  Centres centres;
  make_centres(&centres, tile.left, tile.top);
  Chunk chunk;
  uint at = tile.first;
  for (; at < tile.last && alive != 0; at += UBS_CHUNK) {
    int count = (int)min(tile.last - at, (uint)UBS_CHUNK);
    int ahead = (int)min(tile.last - at - (uint)count, (uint)UBS_CHUNK);
    gather_chunk(&chunk, records, sorted_ids + at, count, ahead, (float)tile.left, (float)tile.top);
    cull_chunk(&chunk, count);
    const int* blocks_of = (const int*)chunk.blocks;
    for (int k = 0; !UBS_FORWARD_ONLY && k < count; ++k)
      masks[sorted_slots[at + (uint)k]] = (ushort)((uint)blocks_of[k] & alive);
    for (uint blocks = alive; blocks != 0; blocks &= blocks - 1) {
      int block = lowest_bit32(blocks);
      if (chunk.hits[block] != 0 && !blend_block(&pixels[block], &chunk, &centres, block))
        alive &= ~(1u << block);
    }
  }
  for (; !UBS_FORWARD_ONLY && at < tile.last; ++at) masks[sorted_slots[at]] = 0;

  for (int block = 0; block < kBlocks; ++block) {
    PixelBlock* p = &pixels[block];
    int corner = block_corner(tile, block);
    store_colour(p->r, p->left, background_r, image + corner, tile.pitch);
    store_colour(p->g, p->left, background_g, image + tile.plane + corner, tile.pitch);
    store_colour(p->b, p->left, background_b, image + 2 * tile.plane + corner, tile.pitch);
    store_block(p->left, transmittance + corner, tile.pitch);
    if (!UBS_DEPTH) continue;
    for (int part = 0; part < kParts; ++part)
      p->depth[part] = blend_expected_depth(p->depth[part], p->weight[part]);
    store_block(p->depth, depth + corner, tile.pitch);
  }
}

#if !UBS_FORWARD_ONLY
#if UBS_VW > 1
// Sums each of four vectors within each group of four lanes. Each group of the result contains the sums (a, b, c, d).
UBS_FN vreal interleave_four(vreal a, vreal b, vreal c, vreal d) {
  vreal ab = unpack_low(a, b) + unpack_high(a, b);
  vreal cd = unpack_low(c, d) + unpack_high(c, d);
  return pairs_low(ab, cd) + pairs_high(ab, cd);
}
#endif

#if UBS_VW < 16
// Returns the sums over all lanes of four vectors.
UBS_FN float4 fold_four(vreal a, vreal b, vreal c, vreal d) {
#if UBS_VW == 1
  return (float4)(a, b, c, d);
#elif UBS_VW == 8
  vreal sums = interleave_four(a, b, c, d);
  return sums.lo + sums.hi;
#else
  return interleave_four(a, b, c, d);
#endif
}
#endif

// Returns the sums over the pixels of a tile, in the order of kGrad*; slot_sum.cl turns them into a gradient. With 16
// lanes the three groups of four are folded together: 31 instead of 39 instructions, and one store instead of four
// (backward 4 % faster). The values after the ten sums have no meaning.
UBS_FN float16 fold_sums(BlendSums s) {
#if UBS_VW == 16
  float16 first = interleave_four(s.hp, s.hq, s.hpp, s.hpq);
  float16 second = interleave_four(s.hqq, s.opacity, s.log_beta, s.r);
  float16 pairs = unpack_low(s.g, s.b) + unpack_high(s.g, s.b);
  float16 third = pairs + pairs.s23016745ab89efcd;
  float16 a = (float16)(first.lo, second.lo) + (float16)(first.hi, second.hi);
  float8 b = third.lo + third.hi;
  return (float16)(a.s0123, a.s89ab, b.s0123, b.s0123) + (float16)(a.s4567, a.scdef, b.s4567, b.s4567);
#else
  return (float16)(fold_four(s.hp, s.hq, s.hpp, s.hpq), fold_four(s.hqq, s.opacity, s.log_beta, s.r),
                   fold_four(s.g, s.b, V(0.0), V(0.0)), (float4)(0.0f));
#endif
}

// The pixels of a block in the backward pass: their positions and the state of blending. They are in one struct, so
// that one address is enough.
typedef struct {
  vreal x[kParts], y[kParts];
  vreal open[kParts];
  vreal remaining[kParts];  // v_pixel . (colour of the splats not yet visited)
  vreal v_r[kParts], v_g[kParts], v_b[kParts];
  vreal unused[kParts];  // pads the struct to a power of two
} Gradients;

UBS_FN void start_gradients(Gradients* blocks, Tile tile, __global const float* image,
                            __global const float* v_image) {
  Centres centres;
  make_centres(&centres, tile.left, tile.top);
  for (int block = 0; block < kBlocks; ++block) {
    Gradients* to = &blocks[block];
    int corner = block_corner(tile, block);
    vreal r[kParts], g[kParts], b[kParts];
    load_block(r, image + corner, tile.pitch);
    load_block(g, image + tile.plane + corner, tile.pitch);
    load_block(b, image + 2 * tile.plane + corner, tile.pitch);
    load_block(to->v_r, v_image + corner, tile.pitch);
    load_block(to->v_g, v_image + tile.plane + corner, tile.pitch);
    load_block(to->v_b, v_image + 2 * tile.plane + corner, tile.pitch);
    for (int part = 0; part < kParts; ++part) {
      to->x[part] = centres.x[block % kBlocksX][part];
      to->y[part] = centres.y[block / kBlocksX][part];
      to->open[part] =
          initial_open(part, block_left(tile, block), block_top(tile, block), tile.width, tile.height);
      to->remaining[part] = r[part] * to->v_r[part] + g[part] * to->v_g[part] + b[part] * to->v_b[part];
    }
  }
}

// Finishes a visit: adds its gradient to the sums.
UBS_FN BlendSums add_visit(BlendSums sums, Gradients* pixels, Visit visit) {
  BlendSplat s = load_blend_splat(visit.record);
  UBS_UNROLL for (int part = 0; part < kParts; ++part) {
    vreal open = pixels->open[part];
    vreal v_r = pixels->v_r[part], v_g = pixels->v_g[part], v_b = pixels->v_b[part];
    BlendAlpha a = blend_end(s, visit.alpha[part]);
    BlendStep step = blend_step(a, open);
    vreal remaining = blend_remaining(s, step, pixels->remaining[part], v_r, v_g, v_b);
    sums = blend_vjp(sums, s, a, step, open, remaining, v_r, v_g, v_b);
    pixels->open[part] = step.open;
    pixels->remaining[part] = remaining;
  }
  return sums;
}

// A tile's list, and the current position in the sequence of visits, which goes through the entries and for each entry
// through its blocks.
typedef struct {
  __global const float* records;
  __global const uint* ids;
  __global const uint* slots;
  __global const ushort* masks;
  uint at, last;                 // index of the next entry; end of the list
  uint slot;                     // of the current entry
  uint blocks;                   // blocks of the current entry that are not visited yet
  __global const float* record;  // of the current entry
} Walk;

// Moves to the next entry that any block composites. Returns 0 at the end of the list. In that case the walk is at the
// first block of the last entry; a visit may be started there but is never finished.
UBS_FN int next_entry(Walk* walk, UBS_SLOTS(__global float*)) {
  for (; walk->at < walk->last; ++walk->at) {
    uint ahead = walk->at + UBS_PREFETCH_DISTANCE;
    if (ahead < walk->last && walk->masks[walk->slots[ahead]] != 0) {
      UBS_PREFETCH(walk->records + (ulong)walk->ids[ahead] * kSplatStride);
      uint next = walk->slots[ahead];
      UBS_PREFETCH_WRITE(UBS_SLOT_PIECE(next) + (ulong)UBS_SLOT_IN_PIECE(next) * kGradStride);
    }
    uint slot = walk->slots[walk->at];
    uint blocks = walk->masks[slot];
    if (blocks != 0) {
      walk->record = walk->records + (ulong)walk->ids[walk->at] * kSplatStride;
      walk->slot = slot;
      walk->blocks = blocks;
      ++walk->at;
      return 1;
    }
  }
  walk->blocks = 1;
  return 0;
}

// Returns the next block of the current entry and marks it as visited.
UBS_FN Gradients* next_block(Walk* walk, Gradients* blocks) {
  int block = lowest_bit32(walk->blocks);
  walk->blocks &= walk->blocks - 1;
  return &blocks[block];
}

UBS_FN Visit begin_next(const Walk* walk, const Gradients* pixels) {
  return begin_visit(walk->record, pixels->x, pixels->y);
}

// As in the forward pass, each visit starts before the previous one is finished, here even if a new splat starts (23 %
// less time).
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void raster_cpu_backward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    __global const float* image, __global const float* v_image, __global const ushort* masks,
    UBS_SLOTS(__global float*) UBS_CORE_PARAMETERS) {
  Tile tile = find_tile(UBS_CORE_GROUP, tile_ranges, tiles_x, tiles_y, width, height);
  Walk walk;
  walk.records = records;
  walk.ids = sorted_ids;
  walk.slots = sorted_slots;
  walk.masks = masks;
  walk.at = tile.first;
  walk.last = tile.last;
  if (!next_entry(&walk, UBS_SLOT_ARGUMENTS)) return;
  Gradients blocks[kBlocks];
  start_gradients(blocks, tile, image, v_image);
  BlendSums sums = blend_no_sums();
  Gradients* pixels = next_block(&walk, blocks);
  Visit visit = begin_next(&walk, pixels);
  for (int more = 1; more;) {
    uint slot = walk.slot;
    int ends = walk.blocks == 0;  // this visit is the last one of its splat
    if (ends) more = next_entry(&walk, UBS_SLOT_ARGUMENTS);
    Gradients* next_pixels = next_block(&walk, blocks);
    Visit next = begin_next(&walk, next_pixels);
    sums = add_visit(sums, pixels, visit);
    if (ends) {
      vstore16(fold_sums(sums), UBS_SLOT_IN_PIECE(slot), UBS_SLOT_PIECE(slot));
      sums = blend_no_sums();
    }
    pixels = next_pixels;
    visit = next;
  }
}
#endif
