// SPDX-License-Identifier: Apache-2.0
// This file contains the definitions that the rasterisers for GPUs share. One work-group processes a tile of 16x16
// pixels, or a part of its list, and one work-item processes one pixel. Sixteen consecutive work-items process a block
// of 4x4 pixels. Each block visits only the splats whose ellipse reaches it.
#pragma once

enum {
  kBlock = 4,
  kBlocksX = kTileSide / kBlock,
  kBlocks = kBlocksX * kBlocksX,
  kLanes = kBlock * kBlock,
  kItems = kTileSide * kTileSide,
};

// TilePixel describes the pixel of a work-item.
typedef struct {
  int block, lane;  // block within the tile; pixel within the block
  int left, top;    // upper left corner of the tile [px]
  int index, plane; // index of the pixel in a plane of the image; number of elements of the plane
  float x, y;       // centre of the pixel [px]
  int inside;       // 1 if the pixel is inside the image, 0 if it is in the padding
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

// SplatRecord holds the values of a splat's record (kernels/layout.h). Blending uses only place, shape and colour.
typedef struct {
  float4 place, shape;  // place: x, y, L00, L01; shape: L11, opacity, beta, red
  float2 colour;        // green, blue
  float depth, reach;
} SplatRecord;

UBS_FN SplatRecord load_record(UBS_GLOBAL const float* records, uint splat) {
  SplatRecord s;
  UBS_GLOBAL const float4* line = (UBS_GLOBAL const float4*)records + (ulong)splat * (kSplatStride / 4);
  s.place = line[0];
  s.shape = line[1];
  float4 tail = line[2], last = line[3];
  s.colour.x = tail.x;
  s.colour.y = tail.y;
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

// Transposes a matrix of bits. Its rows are splats and its columns are blocks. The k-th work-item passes the `blocks`
// of splat k: bit b is set if the splat reaches block b. In the result, bit k of hits[block * words + word] belongs to
// splat word * 32 + k. There are 32 * words splats. All work-items must call this function, and a barrier must follow.
// `all` contains the `blocks` of all splats and is aligned to 16 bytes. It is only read without ballot; in this case a
// barrier must separate the call from the writes to `all`.
UBS_FN void turn_blocks(uint blocks, UBS_LOCAL const uint* all, int words, UBS_LOCAL uint* hits, int item) {
#if UBS_BALLOT
  (void)all;
  int lane = item % 32, word = item / 32;
  if (word >= words) return;  // all lanes of a wave take the same branch
  uint mine = 0;
  UBS_UNROLL for (int block = 0; block < kBlocks; ++block) {
    uint of_block = ballot((int)(blocks >> block & 1u));
    mine = lane == block ? of_block : mine;
  }
  if (lane < kBlocks) hits[lane * words + word] = mine;
#else
  if (item >= kBlocks * words) return;
  int block = item % kBlocks, word = item / kBlocks;
  UBS_LOCAL const uint4* of_word = (UBS_LOCAL const uint4*)all + word * 8;
  uint bits = 0;
  UBS_UNROLL for (int i = 0; i < 8; ++i) {
    uint4 four = (of_word[i] >> (uint)block) & 1u;
    bits |= (four.x | four.y << 1 | four.z << 2 | four.w << 3) << (4 * i);
  }
  hits[block * words + word] = bits;
#endif
}
