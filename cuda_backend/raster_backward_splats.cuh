// SPDX-License-Identifier: Apache-2.0
// Backward rasteriser by splats (KernelConfig::splat_backward): a warp owns a bucket of 32 list entries, a lane a splat.
// The pixels of the tile pass from lane to lane, front to back: at step t lane l visits pixel t - l, takes its state
// from the lane before and adds to its own ten sums, in the order of the pixels. So no sum is taken over lanes, tiles
// with long lists have as many warps as their length asks for, and each (tile, splat) has one writer (with
// UBS_ATOMICS: is added to the splat's gradient). Warps do not meet. Pixels that are closed before the bucket, and
// blocks that none of its splats reaches, are left out.

constexpr int kSplatWarps = 4;  // a block
constexpr int kSplatThreads = 32 * kSplatWarps;

// Of the pixels that pass, in their order.
struct BucketPixels {
  float4 gradient[kTilePixels];  // v_r, v_g, v_b, x
  float2 place[kTilePixels];     // y, the 4x4 block's bit
  float2 state[kTilePixels];     // open, remaining: before the bucket
};

// Blocks of the tile that the mask of any lane has.
__device__ __forceinline__ unsigned any_blocks(unsigned mask) {
  unsigned blocks = 0;
#pragma unroll
  for (int block = 0; block < kBlocks; ++block)
    if (__any_sync(kWholeWarp, static_cast<int>((mask >> block) & 1u))) blocks |= 1u << block;
  return blocks;
}

struct Bucket {
  int tile;
  unsigned first, number;  // of the tile: first entry; bucket `number` of it
  unsigned at, last;       // entries
};

__device__ __forceinline__ void put_pixel(BucketPixels& pixels, int k, const PixelState& p, int block) {
  pixels.gradient[k] = make_float4(p.v_r, p.v_g, p.v_b, p.x);
  pixels.place[k] = make_float2(p.y, __uint_as_float(1u << block));
  pixels.state[k] = make_float2(p.open, p.remaining);
}

// The open pixels of `blocks`, two blocks at a time; returns their number.
__device__ __forceinline__ int gather_pixels(BucketPixels& pixels, const Bucket& bucket, unsigned blocks, int tiles_x,
                                             int plane, int width, int height, const float* image,
                                             const float* v_image, float* states, int lane) {
  int count = 0;
  while (blocks != 0) {
    const int low = __ffs(static_cast<int>(blocks)) - 1;
    blocks &= blocks - 1;
    const int block = lane < kHalfWarp ? low : __ffs(static_cast<int>(blocks)) - 1;  // -1: there is none
    blocks &= blocks - 1;
    PixelState p = {};
    if (block >= 0) {
      const int thread = block * kHalfWarp + lane % kHalfWarp;
      const TilePixel pixel = tile_pixel(bucket.tile, thread, tiles_x, width, height);
      float4 before = make_float4(pixel.inside ? 1.0f : 0.0f, 0.0f, 0.0f, 0.0f);
      if (bucket.number > 0) before = *bucket_state(states, bucket.first, bucket.number, thread);
      p = start_pixel(pixel, plane, image, v_image, before.x, before.y, before.z, before.w);
    }
    const unsigned open = __ballot_sync(kWholeWarp, p.open > 0.0f);
    if (p.open > 0.0f) put_pixel(pixels, count + __popc(open & ((1u << lane) - 1u)), p, block);
    count += __popc(open);
  }
  return count;
}

// Sums of this lane's splat over the pixels, each of which it gets from the lane before.
__device__ __forceinline__ BlendSums pass_pixels(const BucketPixels& pixels, int count, const BatchSplat& s,
                                                 unsigned mask, int lane) {
  BlendSums sums = blend_no_sums();
  PixelState p = {};
  for (int step = 0; step < count + 31; ++step) {
    const float2 fresh = pixels.state[step < count ? step : 0];
    const float open = __shfl_up_sync(kWholeWarp, p.open, 1), remaining = __shfl_up_sync(kWholeWarp, p.remaining, 1);
    p.open = lane == 0 ? fresh.x : open;
    p.remaining = lane == 0 ? fresh.y : remaining;
    const int k = step - lane;
    const bool here = k >= 0 && k < count;
    const float4 gradient = pixels.gradient[here ? k : 0];
    const float2 place = pixels.place[here ? k : 0];
    p.v_r = gradient.x;
    p.v_g = gradient.y;
    p.v_b = gradient.z;
    p.x = gradient.w;
    p.y = place.x;
    sums = visit(sums, s, here && (mask & __float_as_uint(place.y)) != 0, p);
  }
  return sums;
}

// `target`: slot, with UBS_ATOMICS splat.
__device__ __forceinline__ void write_sums(const BlendSums& v, const BlendSplat& splat, unsigned target, float* slots) {
  const float sums[kSums] = {v.hp, v.hq, v.hpp, v.hpq, v.hqq, v.opacity, v.log_beta, v.r, v.g, v.b};
  const BlendFactors factors = blend_factors(splat);
  float values[UBS_GRAD_STRIDE] = {};
#pragma unroll
  for (int value = 0; value < kSums; ++value) values[value] = slot_value(value, sums[value], v.hp, factors);
#ifdef UBS_ATOMICS
#pragma unroll
  for (int value = 0; value < kSums; ++value)
    atomicAdd(slots + static_cast<size_t>(target) * UBS_GRAD_STRIDE + value, values[value]);
#else
  store_slot(slots, target, values);
#endif
}

UBS_KERNEL void __launch_bounds__(kSplatThreads)
    raster_backward(const float* records, const unsigned* sorted_ids, const unsigned* sorted_slots,
                    const unsigned* tile_ranges, int tiles_x, int tiles_y, int width, int height, const float* image,
                    const float* v_image, const unsigned short* masks, float* slots, float* states,
                    const unsigned* order, unsigned* taken) {
  (void)order, (void)taken;  // all buckets are of one size
  __shared__ BucketPixels pixels_of_warps[kSplatWarps];
  const int lane = static_cast<int>(threadIdx.x) % 32, warp = static_cast<int>(threadIdx.x) / 32;
  BucketPixels& pixels = pixels_of_warps[warp];
  const unsigned tiles = static_cast<unsigned>(tiles_x * tiles_y);
  const unsigned place = blockIdx.x * kSplatWarps + static_cast<unsigned>(warp);
  if (place >= first_bucket(tile_ranges, tiles)) return;
  const unsigned tile = tile_of_bucket(tile_ranges, tiles, place);
  Bucket bucket;
  bucket.tile = static_cast<int>(tile);
  bucket.first = tile_ranges[tile];
  bucket.number = place - first_bucket(tile_ranges, tile);
  bucket.at = bucket.first + bucket.number * kBucket;
  bucket.last = tile_ranges[tile + 1];
  if (bucket.at >= bucket.last) return;  // the whole warp

  const unsigned mine = bucket.at + static_cast<unsigned>(lane);
  unsigned slot = 0, mask = 0;
  if (mine < bucket.last) {
    slot = sorted_slots[mine];
    mask = UBS_MASKED_BACKWARD ? masks[slot] : kAllBlocks;
  }
  const unsigned blocks = any_blocks(mask);
  if (blocks == 0) return;
  const int plane = tiles_x * UBS_TILE * tiles_y * UBS_TILE;
  const int count =
      gather_pixels(pixels, bucket, blocks, tiles_x, plane, width, height, image, v_image, states, lane);
  __syncwarp();
  BatchSplat s = {};
  unsigned target = 0;
  if (mask != 0) {
    target = sorted_ids[mine];
    const SplatRecord record = load_splat(records, target);
    s.x = record.place.x;
    s.y = record.place.y;
    s.splat = blend_splat(record);
#ifndef UBS_ATOMICS
    target = slot;
#endif
  }
  const BlendSums sums = count > 0 ? pass_pixels(pixels, count, s, mask, lane) : blend_no_sums();
  if (mask != 0) write_sums(sums, s.splat, target, slots);
}
