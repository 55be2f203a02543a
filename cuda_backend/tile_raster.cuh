// SPDX-License-Identifier: Apache-2.0
// What the forward and the backward rasteriser share: which thread owns which pixel, and a splat's record
// in shared memory. A half-warp of 16 threads is a 4x4 block of pixels, a warp two blocks side by side.
// The macros are those of the OpenCL rasterisers (kernels/variant.h): what is not chosen is not there.

constexpr int kBlockSide = 4;
constexpr int kBlocksAcross = kTileSide / kBlockSide;
constexpr int kBlocks = kBlocksAcross * kBlocksAcross;
constexpr int kHalfWarp = 16;
constexpr int kTilePixels = kTileSide * kTileSide;
constexpr int kWarps = kTilePixels / 32;
constexpr unsigned kWholeWarp = 0xffffffffu;

struct TilePixel {
  int block;      // 4x4 block of the tile, row-major
  int left, top;  // corner of the tile [px]
  int index;      // in a plane
  float x, y;     // centre [px]
  bool inside;    // of the image
};

__device__ __forceinline__ TilePixel tile_pixel(int tile, int thread, int tiles_x, int width, int height) {
  TilePixel p;
  const int lane = thread % kHalfWarp;
  p.block = thread / kHalfWarp;
  p.left = tile % tiles_x * kTileSide;
  p.top = tile / tiles_x * kTileSide;
  const int column = p.left + p.block % kBlocksAcross * kBlockSide + lane % kBlockSide;
  const int row = p.top + p.block / kBlocksAcross * kBlockSide + lane / kBlockSide;
  p.index = row * (tiles_x * kTileSide) + column;
  p.x = static_cast<float>(column) + 0.5f;
  p.y = static_cast<float>(row) + 0.5f;
  p.inside = column < width && row < height;
  return p;
}

// What blending reads of a record, and what only some programs ask for: the compiler drops the loads of the others.
struct SplatRecord {
  float4 place, shape;  // x, y, L00, L01; L11, opacity, beta, r
  float2 colour;        // g, b
  float depth, reach;
};

// As whole 16-byte words.
__device__ __forceinline__ SplatRecord load_splat(const float* records, unsigned splat) {
  SplatRecord s;
  const float4* from = reinterpret_cast<const float4*>(records + static_cast<size_t>(splat) * kSplatStride);
  s.place = from[0];
  s.shape = from[1];
  const float4 tail = from[2], last = from[3];
  s.colour = make_float2(tail.x, tail.y);
  s.depth = last.x;
  s.reach = UBS_OPACITY_EXTENTS ? last.y : UBS_SUPPORT;
  return s;
}

__device__ __forceinline__ BlendSplat blend_splat(const SplatRecord& s) {
  BlendSplat b;
  b.l00 = s.place.z;
  b.l01 = s.place.w;
  b.l11 = s.shape.x;
  b.opacity = s.shape.y;
  b.beta = s.shape.z;
  b.r = s.shape.w;
  b.g = s.colour.x;
  b.b = s.colour.y;
  return b;
}

// Leading ten values of a record in three arrays of `size` splats: 40 bytes a splat, read as 16 + 16 + 8 by
// all threads of a half-warp at one address.
template <int size>
struct SplatBatch {
  float4 place[size];   // x, y, L00, L01
  float4 shape[size];   // L11, opacity, beta, r
  float2 colour[size];  // g, b
};

template <int size>
__device__ __forceinline__ void put_splat(SplatBatch<size>& batch, int k, const SplatRecord& s) {
  batch.place[k] = s.place;
  batch.shape[k] = s.shape;
  batch.colour[k] = s.colour;
}

struct BatchSplat {
  BlendSplat splat;
  float x, y;
};
template <int size>
__device__ __forceinline__ BatchSplat batch_splat(const SplatBatch<size>& batch, int k) {
  SplatRecord s;
  s.place = batch.place[k];
  s.shape = batch.shape[k];
  s.colour = batch.colour[k];
  BatchSplat b;
  b.x = s.place.x;
  b.y = s.place.y;
  b.splat = blend_splat(s);
  return b;
}

// Turns the blocks of 32 splats, one a lane, into one word a block: bit k of hits[block * stride] is splat k.
__device__ __forceinline__ void transpose_blocks(unsigned blocks, unsigned* hits, int stride, int lane) {
  unsigned mine = 0;
#pragma unroll
  for (int block = 0; block < kBlocks; ++block) {
    const unsigned word = __ballot_sync(kWholeWarp, (blocks >> block) & 1u);
    if (lane == block) mine = word;
  }
  if (lane < kBlocks) hits[lane * stride] = mine;
}
