// SPDX-License-Identifier: Apache-2.0
// Rasteriser for CPUs: one work-item is one 16x16 tile, without barriers. Pixels are handled in blocks of
// 4x4 as vectors of UBS_VW lanes (16 / UBS_VW of them a block), splats in chunks of 64: per chunk each
// block gets the set of splats whose ellipse reaches it as one 64-bit word, then blends only those.
// Forward also stores which blocks of the tile a splat was composited in; backward visits only these.
// Structure and its measurements: docs/performance.md.

#define UBS_BLOCK 4
#define UBS_BLOCKS_X (UBS_TILE / UBS_BLOCK)
#define UBS_BLOCKS (UBS_BLOCKS_X * UBS_BLOCKS_X)
#define UBS_PARTS (UBS_BLOCK * UBS_BLOCK / UBS_VW)
#define UBS_CHUNK 64
// Splats ahead of the current one whose cache lines backward asks for.
#ifndef UBS_PREFETCH_DISTANCE
#define UBS_PREFETCH_DISTANCE 12
#endif

// Pixel centres of part `part` of a block, relative to the block's corner.
UBS_FN vreal part_x(int part) {
  float x[UBS_VW];
  for (int lane = 0; lane < UBS_VW; ++lane) x[lane] = (float)((part * UBS_VW + lane) % UBS_BLOCK) + 0.5f;
  return UBS_LOAD(x);
}
UBS_FN vreal part_y(int part) {
  float y[UBS_VW];
  for (int lane = 0; lane < UBS_VW; ++lane) y[lane] = (float)((part * UBS_VW + lane) / UBS_BLOCK) + 0.5f;
  return UBS_LOAD(y);
}

// Pixel centres of a tile's block columns and rows; one table for both directions, because backward must
// repeat the alpha of forward to the bit.
typedef struct {
  vreal x[UBS_BLOCKS_X][UBS_PARTS], y[UBS_BLOCKS_X][UBS_PARTS];
} Centres;

UBS_FN void make_centres(Centres* centres, int left, int top) {
  for (int i = 0; i < UBS_BLOCKS_X; ++i) {
    for (int part = 0; part < UBS_PARTS; ++part) {
      centres->x[i][part] = part_x(part) + (float)(left + i * UBS_BLOCK);
      centres->y[i][part] = part_y(part) + (float)(top + i * UBS_BLOCK);
    }
  }
}

UBS_FN void store_block(const vreal* parts, __global float* plane, int pitch) {
  float pixels[UBS_BLOCK * UBS_BLOCK];
  for (int part = 0; part < UBS_PARTS; ++part) UBS_STORE(parts[part], pixels + part * UBS_VW);
  for (int row = 0; row < UBS_BLOCK; ++row) vstore4(vload4(row, pixels), 0, plane + row * pitch);
}

UBS_FN void load_block(vreal* parts, __global const float* plane, int pitch) {
  float pixels[UBS_BLOCK * UBS_BLOCK];
  for (int row = 0; row < UBS_BLOCK; ++row) vstore4(vload4(0, plane + row * pitch), row, pixels);
  for (int part = 0; part < UBS_PARTS; ++part) parts[part] = UBS_LOAD(pixels + part * UBS_VW);
}

// 1 for pixels of the image, 0 for those of the padding, which are closed from the start.
UBS_FN vreal initial_open(int part, int left, int top, int width, int height) {
  vreal x = part_x(part) + (float)left;
  vreal y = part_y(part) + (float)top;
  return ((x < (vreal)((float)width)) & (y < (vreal)((float)height))) ? V(1.0) : V(0.0);
}

UBS_FN BlendSplat load_blend_splat(const float* record) {
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

// One chunk of splats of a tile: their records side by side, and the words of the blocks.
typedef struct {
  float16 records[UBS_CHUNK];
  vreal x[UBS_CHUNK / UBS_VW], y[UBS_CHUNK / UBS_VW];
  vreal l00[UBS_CHUNK / UBS_VW], l01[UBS_CHUNK / UBS_VW], l11[UBS_CHUNK / UBS_VW];
  vmask blocks[UBS_CHUNK / UBS_VW];  // per splat: bit b is set if it reaches block b
  ulong hits[UBS_BLOCKS];            // per block: bit k is set if splat k reaches it
} Chunk;

// Copies the records and asks for those of the next chunk. Lanes beyond count keep what they hold.
UBS_FN void gather_chunk(Chunk* chunk, __global const float* records, __global const uint* ids, int count,
                         int ahead, float left, float top) {
  for (int k = 0; k < count; ++k) {
    float16 record = vload16(ids[k], records);
    chunk->records[k] = record;
    ((float*)chunk->x)[k] = record.s0 - left;
    ((float*)chunk->y)[k] = record.s1 - top;
    ((float*)chunk->l00)[k] = record.s2;
    ((float*)chunk->l01)[k] = record.s3;
    ((float*)chunk->l11)[k] = record.s4;
    if (k < ahead) UBS_PREFETCH_READ(records + (ulong)ids[k + UBS_CHUNK] * UBS_SPLAT_STRIDE);
  }
}

UBS_FN void cull_chunk(Chunk* chunk, int count) {
  for (int block = 0; block < UBS_BLOCKS; ++block) chunk->hits[block] = 0;
  for (int group = 0; group * UBS_VW < count; ++group) {
    CullSplat s =
        cull_splat(chunk->x[group], chunk->y[group], chunk->l00[group], chunk->l01[group], chunk->l11[group]);
    vmask blocks = (vmask)(0);
    CullSpan across[UBS_BLOCKS_X];
    for (int bx = 0; bx < UBS_BLOCKS_X; ++bx) across[bx] = cull_span(s.x, bx * 4.0f + 2.0f);
    for (int by = 0; by < UBS_BLOCKS_X; ++by) {
      CullSpan down = cull_span(s.y, by * 4.0f + 2.0f);
      for (int bx = 0; bx < UBS_BLOCKS_X; ++bx) {
        int block = by * UBS_BLOCKS_X + bx;
        vmask meets = cull_meets(s, across[bx], down);
        blocks |= meets ? (vmask)(1 << block) : (vmask)(0);
        chunk->hits[block] |= (ulong)lane_bits(meets) << (group * UBS_VW);
      }
    }
    chunk->blocks[group] = blocks;
  }
  ulong valid = ~0UL >> (UBS_CHUNK - count);
  for (int block = 0; block < UBS_BLOCKS; ++block) chunk->hits[block] &= valid;
}

// State of a tile's pixels while splats are blended.
typedef struct {
  vreal open[UBS_BLOCKS][UBS_PARTS];  // transmittance while the pixel goes on, 0 afterwards
  vreal left[UBS_BLOCKS][UBS_PARTS];  // transmittance
  vreal r[UBS_BLOCKS][UBS_PARTS], g[UBS_BLOCKS][UBS_PARTS], b[UBS_BLOCKS][UBS_PARTS];
#ifdef UBS_DEPTH
  vreal depth[UBS_BLOCKS][UBS_PARTS], weight[UBS_BLOCKS][UBS_PARTS];
#endif
} Pixels;

// Blends the chunk's splats that reach a block; sets the block's bit in the masks of those composited.
// Returns whether any pixel of the block is still open.
UBS_FN int blend_block(Pixels* pixels, const Chunk* chunk, const Centres* centres, int block) {
  vreal open[UBS_PARTS], rest[UBS_PARTS], r[UBS_PARTS], g[UBS_PARTS], b[UBS_PARTS], x[UBS_PARTS],
      y[UBS_PARTS];
#ifdef UBS_DEPTH
  vreal depth[UBS_PARTS], weight[UBS_PARTS];
#endif
  for (int part = 0; part < UBS_PARTS; ++part) {
    open[part] = pixels->open[block][part];
    rest[part] = pixels->left[block][part];
    r[part] = pixels->r[block][part];
    g[part] = pixels->g[block][part];
    b[part] = pixels->b[block][part];
    x[part] = centres->x[block % UBS_BLOCKS_X][part];
    y[part] = centres->y[block / UBS_BLOCKS_X][part];
#ifdef UBS_DEPTH
    depth[part] = pixels->depth[block][part];
    weight[part] = pixels->weight[block][part];
#endif
  }
  for (ulong hits = chunk->hits[block]; hits != 0; hits &= hits - 1) {
    int k = lowest_bit(hits);
    const float* record = (const float*)&chunk->records[k];
    BlendSplat s = load_blend_splat(record);

    for (int part = 0; part < UBS_PARTS; ++part) {
      BlendAlpha a = blend_alpha(s, record[UBS_S_X] - x[part], record[UBS_S_Y] - y[part]);
      BlendStep step = blend_step(a, open[part]);
      r[part] += step.weight * s.r;
      g[part] += step.weight * s.g;
      b[part] += step.weight * s.b;
      rest[part] = step.composited ? step.open : rest[part];
      open[part] = step.open;
#ifdef UBS_DEPTH
      depth[part] += step.weight * record[UBS_S_DEPTH];
      weight[part] += step.weight;
#endif
    }
  }
  vmask going = (vmask)(0);
  for (int part = 0; part < UBS_PARTS; ++part) {
    going |= open[part] > V(0.0);
    pixels->open[block][part] = open[part];
    pixels->left[block][part] = rest[part];
    pixels->r[block][part] = r[part];
    pixels->g[block][part] = g[part];
    pixels->b[block][part] = b[part];
#ifdef UBS_DEPTH
    pixels->depth[block][part] = depth[part];
    pixels->weight[block][part] = weight[part];
#endif
  }
  return any_lane(going);
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void raster_cpu_forward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height, float background_r,
    float background_g, float background_b, __global float* image, __global float* transmittance,
    __global float* depth, __global ushort* masks) {
  int tile = (int)get_group_id(0);
  int left = tile % tiles_x * UBS_TILE, top = tile / tiles_x * UBS_TILE;
  int pitch = tiles_x * UBS_TILE;
  int plane = pitch * tiles_y * UBS_TILE;
  uint first = tile_ranges[tile], last = tile_ranges[tile + 1];

  Pixels pixels;
  uint alive = 0;
  for (int block = 0; block < UBS_BLOCKS; ++block) {
    int bx = left + block % UBS_BLOCKS_X * UBS_BLOCK, by = top + block / UBS_BLOCKS_X * UBS_BLOCK;
    if (bx < width && by < height) alive |= 1u << block;
    for (int part = 0; part < UBS_PARTS; ++part) {
      pixels.open[block][part] = initial_open(part, bx, by, width, height);
      pixels.left[block][part] = V(1.0);
      pixels.r[block][part] = pixels.g[block][part] = pixels.b[block][part] = V(0.0);
#ifdef UBS_DEPTH
      pixels.depth[block][part] = pixels.weight[block][part] = V(0.0);
#endif
    }
  }

  Centres centres;
  make_centres(&centres, left, top);
  Chunk chunk;
  uint at = first;
  for (; at < last && alive != 0; at += UBS_CHUNK) {
    int count = (int)min(last - at, (uint)UBS_CHUNK);
    int ahead = (int)min(last - at - (uint)count, (uint)UBS_CHUNK);
    gather_chunk(&chunk, records, sorted_ids + at, count, ahead, (float)left, (float)top);
    cull_chunk(&chunk, count);
    const int* blocks_of = (const int*)chunk.blocks;
    for (int k = 0; k < count; ++k) masks[sorted_slots[at + (uint)k]] = (ushort)((uint)blocks_of[k] & alive);
    for (uint blocks = alive; blocks != 0; blocks &= blocks - 1) {
      int block = lowest_bit32(blocks);
      if (chunk.hits[block] == 0) continue;
      if (!blend_block(&pixels, &chunk, &centres, block)) alive &= ~(1u << block);
    }
  }
  for (; at < last; ++at) masks[sorted_slots[at]] = 0;

  for (int block = 0; block < UBS_BLOCKS; ++block) {
    int corner = (top + block / UBS_BLOCKS_X * UBS_BLOCK) * pitch + left + block % UBS_BLOCKS_X * UBS_BLOCK;
    for (int part = 0; part < UBS_PARTS; ++part) {
      pixels.r[block][part] += pixels.left[block][part] * background_r;
      pixels.g[block][part] += pixels.left[block][part] * background_g;
      pixels.b[block][part] += pixels.left[block][part] * background_b;
#ifdef UBS_DEPTH
      pixels.depth[block][part] = blend_expected_depth(pixels.depth[block][part], pixels.weight[block][part]);
#endif
    }
    store_block(pixels.r[block], image + corner, pitch);
    store_block(pixels.g[block], image + plane + corner, pitch);
    store_block(pixels.b[block], image + 2 * plane + corner, pitch);
    store_block(pixels.left[block], transmittance + corner, pitch);
#ifdef UBS_DEPTH
    store_block(pixels.depth[block], depth + corner, pitch);
#endif
  }
}

// Sums over the lanes of four vectors, not finished: four lanes of each side by side.
UBS_FN float16 fold_four(vreal a, vreal b, vreal c, vreal d) {
#if UBS_VW == 16
  float16 ab = (float16)(a.lo + a.hi, b.lo + b.hi);
  float16 cd = (float16)(c.lo + c.hi, d.lo + d.hi);
#elif UBS_VW == 8
  float16 ab = (float16)(a, b);
  float16 cd = (float16)(c, d);
#endif
#if UBS_VW >= 8
  return (float16)(ab.s0123 + ab.s4567, ab.s89ab + ab.scdef, cd.s0123 + cd.s4567, cd.s89ab + cd.scdef);
#elif UBS_VW == 4
  return (float16)(a, b, c, d);
#else
  return (float16)(a, 0, 0, 0, b, 0, 0, 0, c, 0, 0, 0, d, 0, 0, 0);
#endif
}
// Lanes 4i .. 4i+3 of two vectors -> their sums, at i and 8 + i... as pairs, then as single values.
UBS_FN float16 fold_pairs(float16 a, float16 b) {
  return (float16)(a.s014589cd + a.s2367abef, b.s014589cd + b.s2367abef);
}
UBS_FN float16 fold_last(float16 a, float16 b) { return (float16)(a.even + a.odd, b.even + b.odd); }

// Sums over all lanes, in the order of a gradient record.
UBS_FN float16 fold(BlendSums s) {
  float16 left =
      fold_pairs(fold_four(s.hx, s.hy, s.hxx, s.hxy), fold_four(s.hyy, s.opacity, s.log_beta, s.r));
  return fold_last(left, fold_pairs(fold_four(s.g, s.b, V(0.0), V(0.0)), (float16)(0.0f)));
}

// blend_factors applied to a gradient record (UBS_G_*) of sums.
UBS_FN void store_gradient(float16 sums, BlendFactors f, __global float* slot) {
  float4 mean_and_conic = sums.lo.lo * (float4)(f.xx, f.yy, f.square, 2.0f * f.square);
  mean_and_conic += sums.s1032 * (float4)(f.xy, f.xy, 0.0f, 0.0f);
  vstore4(mean_and_conic, 0, slot);
  vstore4(sums.s4567 * (float4)(f.square, 1.0f, UBS_LN2, 1.0f), 1, slot);
  vstore8(sums.hi, 1, slot);
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void raster_cpu_backward(
    __global const float* records, __global const uint* sorted_ids, __global const uint* sorted_slots,
    __global const uint* tile_ranges, int tiles_x, int tiles_y, int width, int height,
    __global const float* image, __global const float* v_image, __global const ushort* masks,
    __global float* slots) {
  int tile = (int)get_group_id(0);
  int left = tile % tiles_x * UBS_TILE, top = tile / tiles_x * UBS_TILE;
  int pitch = tiles_x * UBS_TILE;
  int plane = pitch * tiles_y * UBS_TILE;
  uint first = tile_ranges[tile], last = tile_ranges[tile + 1];

  vreal open[UBS_BLOCKS][UBS_PARTS], remaining[UBS_BLOCKS][UBS_PARTS];
  vreal v_r[UBS_BLOCKS][UBS_PARTS], v_g[UBS_BLOCKS][UBS_PARTS], v_b[UBS_BLOCKS][UBS_PARTS];
  for (int block = 0; block < UBS_BLOCKS; ++block) {
    int bx = left + block % UBS_BLOCKS_X * UBS_BLOCK, by = top + block / UBS_BLOCKS_X * UBS_BLOCK;
    int corner = by * pitch + bx;
    vreal r[UBS_PARTS], g[UBS_PARTS], b[UBS_PARTS];
    load_block(r, image + corner, pitch);
    load_block(g, image + plane + corner, pitch);
    load_block(b, image + 2 * plane + corner, pitch);
    load_block(v_r[block], v_image + corner, pitch);
    load_block(v_g[block], v_image + plane + corner, pitch);
    load_block(v_b[block], v_image + 2 * plane + corner, pitch);
    for (int part = 0; part < UBS_PARTS; ++part) {
      open[block][part] = initial_open(part, bx, by, width, height);
      remaining[block][part] =
          r[part] * v_r[block][part] + g[part] * v_g[block][part] + b[part] * v_b[block][part];
    }
  }
  Centres centres;
  make_centres(&centres, left, top);

  for (uint at = first; at < last; ++at) {
    if (at + UBS_PREFETCH_DISTANCE < last) {
      uint slot_ahead = sorted_slots[at + UBS_PREFETCH_DISTANCE];
      if (masks[slot_ahead] != 0) {
        UBS_PREFETCH_READ(records + (ulong)sorted_ids[at + UBS_PREFETCH_DISTANCE] * UBS_SPLAT_STRIDE);
        UBS_PREFETCH_WRITE(slots + (ulong)slot_ahead * UBS_GRAD_STRIDE);
      }
    }
    uint slot = sorted_slots[at];
    uint blocks = masks[slot];
    if (blocks == 0) continue;
    __global const float* global_record = records + (ulong)sorted_ids[at] * UBS_SPLAT_STRIDE;
    float record[UBS_SPLAT_STRIDE];
    vstore16(vload16(0, global_record), 0, record);
    BlendSums sums = blend_no_sums();
    for (; blocks != 0; blocks &= blocks - 1) {
      int block = lowest_bit32(blocks);
      BlendSplat s = load_blend_splat(record);

      for (int part = 0; part < UBS_PARTS; ++part) {
        vreal dx = record[UBS_S_X] - centres.x[block % UBS_BLOCKS_X][part];
        vreal dy = record[UBS_S_Y] - centres.y[block / UBS_BLOCKS_X][part];
        BlendAlpha a = blend_alpha(s, dx, dy);
        BlendStep step = blend_step(a, open[block][part]);
        vreal rest = blend_remaining(s, step, remaining[block][part], v_r[block][part], v_g[block][part],
                                     v_b[block][part]);
        sums = blend_vjp(sums, s, a, step, dx, dy, open[block][part], rest, v_r[block][part],
                         v_g[block][part], v_b[block][part]);
        open[block][part] = step.open;
        remaining[block][part] = rest;
      }
    }
    store_gradient(fold(sums), blend_factors(load_blend_splat(record)),
                   slots + (ulong)slot * UBS_GRAD_STRIDE);
  }
}
