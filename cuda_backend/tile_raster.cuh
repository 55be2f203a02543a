// SPDX-License-Identifier: Apache-2.0
// What the forward and the backward rasteriser share: which thread owns which pixel, and a splat's record
// in shared memory. A half-warp of 16 threads is a 4x4 block of pixels, a warp two blocks side by side.
// Included inside of the unnamed namespace of raster_kernels.cu.

constexpr int kBlockSide = 4;
constexpr int kBlocksAcross = UBS_TILE / kBlockSide;
constexpr int kBlocks = kBlocksAcross * kBlocksAcross;
constexpr int kHalfWarp = 16;
constexpr int kWarps = UBS_TILE * UBS_TILE / 32;
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
  p.left = tile % tiles_x * UBS_TILE;
  p.top = tile / tiles_x * UBS_TILE;
  const int column = p.left + p.block % kBlocksAcross * kBlockSide + lane % kBlockSide;
  const int row = p.top + p.block / kBlocksAcross * kBlockSide + lane / kBlockSide;
  p.index = row * (tiles_x * UBS_TILE) + column;
  p.x = static_cast<float>(column) + 0.5f;
  p.y = static_cast<float>(row) + 0.5f;
  p.inside = column < width && row < height;
  return p;
}

// Leading ten values of a record in three arrays of `size` splats: 40 bytes a splat, read as 16 + 16 + 8 by
// all threads of a half-warp at one address.
template <int size>
struct SplatBatch {
  float4 place[size];   // x, y, L00, L01
  float4 shape[size];   // L11, opacity, beta, r
  float2 colour[size];  // g, b
};

// Loads the record of a splat as whole 16-byte words into entry k and returns the first two of them.
struct RecordHead {
  float4 place, shape;
};
template <int size>
__device__ __forceinline__ RecordHead load_record(SplatBatch<size>& batch, int k, const float* records,
                                                  unsigned splat) {
  const float4* from =
      reinterpret_cast<const float4*>(records + static_cast<size_t>(splat) * UBS_SPLAT_STRIDE);
  const RecordHead head = {from[0], from[1]};
  const float4 tail = from[2];
  batch.place[k] = head.place;
  batch.shape[k] = head.shape;
  batch.colour[k] = make_float2(tail.x, tail.y);
  return head;
}

struct BatchSplat {
  BlendSplat splat;
  float x, y;
};
template <int size>
__device__ __forceinline__ BatchSplat batch_splat(const SplatBatch<size>& batch, int k) {
  const float4 place = batch.place[k], shape = batch.shape[k];
  const float2 colour = batch.colour[k];
  BatchSplat b;
  b.x = place.x;
  b.y = place.y;
  b.splat.l00 = place.z;
  b.splat.l01 = place.w;
  b.splat.l11 = shape.x;
  b.splat.opacity = shape.y;
  b.splat.beta = shape.z;
  b.splat.r = shape.w;
  b.splat.g = colour.x;
  b.splat.b = colour.y;
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
