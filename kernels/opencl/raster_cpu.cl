// SPDX-License-Identifier: Apache-2.0
// This file contains the rasteriser for CPUs. One work-item processes one tile of 16x16 pixels, without barriers. The
// pixels of a tile form blocks of 4x4. A block is processed in 16 / UBS_VW parts, each of which is a vector of UBS_VW
// lanes. The splats of a tile are processed in chunks of UBS_CHUNK splats. For each chunk and each block, a word of 64
// bits contains the set of those splats whose ellipse reaches the block, and only these are blended. The forward pass
// also stores which open blocks of the tile a splat reaches; the backward pass visits only these blocks. Loops over
// parts have UBS_UNROLL, because otherwise structs are copied by calls of memcpy, which doubles the time with 8 lanes.
// docs/performance.md describes the structure and measurements.

enum {
  kBlock = 4,
  kBlocksX = kTileSide / kBlock,
  kBlocks = kBlocksX * kBlocksX,
  kParts = kBlock * kBlock / UBS_VW,
};
// The following constants are tuned (host/opencl/opencl_tuning.cpp). UBS_CHUNK is the number of splats of a chunk. It
// is a multiple of UBS_VW, and at most 64, the number of bits of a word.
#ifndef UBS_CHUNK
#define UBS_CHUNK 64
#endif
// The backward pass prefetches the cache lines of the splat that follows this number of entries later.
#ifndef UBS_PREFETCH_DISTANCE
#define UBS_PREFETCH_DISTANCE 12
#endif

// UBS_SCATTER selects the order in which tiles are assigned to work-groups.
// By default PoCL gives each thread runs of consecutive work-groups, and the first run consists of a quarter to a half
// of all groups. Therefore UBS_SCATTER is a prime, which scatters the tiles over the groups, so that no run consists of
// the expensive middle of the image. This saves 10 % of the time for images of 200x200 pixels.
// If cores claim their groups themselves (opencl/core_groups.h), UBS_SCATTER is 1. Then each core processes rows of the
// image, starting in the middle of the image, so that cheap tiles remain for the end and the load is balanced.
#ifndef UBS_SCATTER
#define UBS_SCATTER 31
#endif
UBS_FN int tile_of_group(uint group, uint tiles) {
#if UBS_SCATTER == 1
  return (int)(group < tiles / 2 ? tiles / 2 - 1 - group : group);
#else
  return (int)(tiles % UBS_SCATTER == 0 ? group : group * (uint)UBS_SCATTER % tiles);
#endif
}

// Returns the centre of column i or row i of blocks, relative to the tile's corner [px].
UBS_FN float block_centre(int i) { return (float)(i * kBlock) + 0.5f * kBlock; }

// part_x() and part_y() return the coordinates of the pixel centres of a part of a block, relative to the block's
// corner [px].
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

// Centres holds the pixel centres of the block columns and block rows of a tile. Both passes use the same table,
// because the backward pass must compute alphas that are bit-identical to those of the forward pass.
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

// Returns 1 for pixels of the image, and 0 for pixels of the padding, which are closed from the start.
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

// Chunk holds one chunk of a tile's splats, and the splats that reach each block.
typedef struct {
  __global const float* lines[UBS_CHUNK];  // pointers to the records
  vreal x[UBS_CHUNK / UBS_VW], y[UBS_CHUNK / UBS_VW];
  vreal l00[UBS_CHUNK / UBS_VW], l01[UBS_CHUNK / UBS_VW], l11[UBS_CHUNK / UBS_VW];
  vreal reach[UBS_CHUNK / UBS_VW];   // only with UBS_OPACITY_EXTENTS
  vmask blocks[UBS_CHUNK / UBS_VW];  // for each splat, bit b is set if the splat reaches block b
  ulong hits[kBlocks];               // for each block, bit k is set if splat k of the chunk reaches the block
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
// With this test, 1.5 % of the visits of splats to blocks have no effect. If only the bounding boxes of the footprints
// were tested, 40 % would have no effect.
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

// Visit is the state of blending a splat into the pixels of a block, after blend_begin() and before blend_end().
typedef struct {
  __global const float* record;
  BlendAlpha alpha[kParts];
} Visit;

// Starts a visit. The record is read again for each block. If its values were kept as vectors during a loop, they would
// displace sums from the registers.
UBS_FN Visit begin_visit(__global const float* record, const vreal* x, const vreal* y) {
  Visit visit;
  visit.record = record;
  UBS_UNROLL for (int part = 0; part < kParts; ++part)
    visit.alpha[part] =
        blend_begin(load_blend_splat(record), record[kSplatX] - x[part], record[kSplatY] - y[part]);
  return visit;
}

// PixelBlock is the state of a block's pixels while splats are blended.
typedef struct {
  vreal open[kParts];  // transmittance while the pixel is open, 0 after it has been closed
  vreal left[kParts];  // transmittance after the last composited splat
  vreal r[kParts], g[kParts], b[kParts];
  vreal depth[kParts], weight[kParts];  // only with UBS_DEPTH
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

// Blends those splats of the chunk that reach a block. There must be at least one. Returns whether any pixel of the
// block is still open. This is tested once per chunk: after all pixels have been closed, only the rest of the chunk is
// computed in vain, whereas with a test after each splat, the loop would wait for each result and take three times as
// long.
// Each visit starts before the previous one is finished. Then the logarithm for one splat and the power for the
// previous splat are computed at the same time. Each of them is a chain of about as many instructions as the CPU can
// look ahead. This saves 15 % of the time.
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

// Tile describes the tile of a work-item.
typedef struct {
  int left, top, width, height;  // upper left corner of the tile, and size of the image [px]
  int pitch, plane;              // numbers of elements of a row and of a plane of the image
  uint first, last;              // the list of the tile consists of the entries from first to last - 1
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

// Initialises the pixels. Returns the bit mask of the blocks that contain pixels of the image.
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
// Sums each of four vectors within each group of four lanes. Each group of four lanes of the result contains the sums
// of a, b, c and d over this group.
UBS_FN vreal interleave_four(vreal a, vreal b, vreal c, vreal d) {
  vreal ab = unpack_low(a, b) + unpack_high(a, b);
  vreal cd = unpack_low(c, d) + unpack_high(c, d);
  return pairs_low(ab, cd) + pairs_high(ab, cd);
}
#endif

#if UBS_VW < 16
// Returns, for each of four vectors, the sum over all lanes.
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

// Returns the ten sums over the pixels of a tile, in the order of kGrad*. slot_sum.cl computes the gradient from them.
// The values after the ten sums have no meaning. With 16 lanes, all sums are computed together. This takes 31
// instructions and one store, whereas four sums at a time would take 39 instructions and four stores. It makes the
// backward pass 4 % faster.
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

// Gradients holds the pixels of a block in the backward pass: their positions, their gradients, and the state of
// blending. All values are in one struct, so that one address is enough.
typedef struct {
  vreal x[kParts], y[kParts];
  vreal open[kParts];
  // Dot product of the gradient and the colour that the splats that follow and the background contribute.
  vreal remaining[kParts];
  vreal v_r[kParts], v_g[kParts], v_b[kParts];
  vreal unused[kParts];  // pads the struct to a power of two
} Gradients;

UBS_FN void start_gradients(Gradients* blocks, Tile tile, __global const float* image,
                            __global const float* v_image, __global const float* v_more, int more_channels) {
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
    vreal further[kParts];
    if (UBS_ABSGRAD && more_channels > 0) load_block(further, v_more + corner, tile.pitch);
    for (int part = 0; part < kParts; ++part) {
      to->x[part] = centres.x[block % kBlocksX][part];
      to->y[part] = centres.y[block / kBlocksX][part];
      to->open[part] =
          initial_open(part, block_left(tile, block), block_top(tile, block), tile.width, tile.height);
      to->remaining[part] = r[part] * to->v_r[part] + g[part] * to->v_g[part] + b[part] * to->v_b[part];
      if (UBS_ABSGRAD && more_channels > 0) to->remaining[part] += further[part];
    }
  }
}

// Adds the dot products of the further channels of a splat, `colours`, and their gradients at the pixels of a block to
// `shades`. `v` are the planes of the gradients, starting at the corner of the block. Only used with UBS_ABSGRAD.
UBS_FN void add_more_channels(vreal* shades, __global const float* colours, int channels, __global const float* v,
                              Tile tile) {
  for (int c = 0; c < channels; ++c) {
    vreal gradients[kParts];
    load_block(gradients, v + (ulong)c * (ulong)tile.plane, tile.pitch);
    for (int part = 0; part < kParts; ++part) shades[part] += colours[c] * gradients[part];
  }
}

// Finishes a visit and adds its gradient to the sums. `more` contains the sums of add_more_channels() for the block.
UBS_FN BlendSums add_visit(BlendSums sums, Gradients* pixels, Visit visit, const vreal* more) {
  BlendSplat s = load_blend_splat(visit.record);
  UBS_UNROLL for (int part = 0; part < kParts; ++part) {
    vreal open = pixels->open[part];
    vreal v_r = pixels->v_r[part], v_g = pixels->v_g[part], v_b = pixels->v_b[part];
    BlendAlpha a = blend_end(s, visit.alpha[part]);
    BlendStep step = blend_step(a, open);
    vreal shade = blend_shade(s, v_r, v_g, v_b);
    if (UBS_ABSGRAD) shade += more[part];
    vreal remaining = blend_remaining(step, pixels->remaining[part], shade);
    sums = blend_vjp(sums, s, a, step, open, remaining, shade, v_r, v_g, v_b);
    pixels->open[part] = step.open;
    pixels->remaining[part] = remaining;
  }
  return sums;
}

// Walk is an iterator over the visits of a tile. It goes through the entries of the tile's list, and for each entry
// through the blocks that the splat reaches.
typedef struct {
  __global const float* records;
  __global const uint* ids;
  __global const uint* slots;
  __global const ushort* masks;
  uint at, last;                 // index of the next entry; end of the list
  uint slot;                     // slot of the current entry
  uint blocks;                   // bit mask of the blocks of the current entry that have not been visited yet
  __global const float* record;  // record of the splat of the current entry
} Walk;

// Moves to the next entry with a mask that is not 0, and returns 1. At the end of the list, returns 0. In this case the
// walk is at block 0 of the last entry, so that the caller may start one more visit, which is never finished.
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

// Computes the sums of the gradients for the slots of a tile. As in the forward pass, each visit starts before the
// previous one is finished, even if the two visits are those of different splats. This saves 23 % of the time. With
// UBS_ABSGRAD, there may be further channels, as in gpu/raster_backward.cl.
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void raster_cpu_backward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    __global const float* image, __global const float* v_image, __global const ushort* masks,
    __global const float* more_colours, __global const float* v_more, int more_channels,
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
  start_gradients(blocks, tile, image, v_image, v_more, more_channels);
  BlendSums sums = blend_no_sums();
  Gradients* pixels = next_block(&walk, blocks);
  Visit visit = begin_next(&walk, pixels);
  for (int more = 1; more;) {
    uint slot = walk.slot;
    int ends = walk.blocks == 0;  // 1 if this visit is the last one of its splat
    if (ends) more = next_entry(&walk, UBS_SLOT_ARGUMENTS);
    Gradients* next_pixels = next_block(&walk, blocks);
    Visit next = begin_next(&walk, next_pixels);
    vreal further[kParts] = {V(0.0)};
    if (UBS_ABSGRAD) {
      ulong splat = (ulong)(visit.record - records) / kSplatStride;
      add_more_channels(further, more_colours + splat * (ulong)more_channels, more_channels,
                        v_more + tile.plane + block_corner(tile, (int)(pixels - blocks)), tile);
    }
    sums = add_visit(sums, pixels, visit, further);
    if (ends) {
      vstore16(fold_sums(sums), UBS_SLOT_IN_PIECE(slot), UBS_SLOT_PIECE(slot));
      sums = blend_no_sums();
    }
    pixels = next_pixels;
    visit = next;
  }
}
#endif
