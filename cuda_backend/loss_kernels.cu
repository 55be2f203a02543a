// SPDX-License-Identifier: Apache-2.0
// L1 + SSIM loss of an image and its gradient (formulas: kernels/math/loss.h). A block takes one tile of one
// channel; the window sums are separable: columns first, into shared memory, then rows.
//   loss_window    image, target -> sums of the tile; with `gradient` also the three maps of ssim_point,
//                  planes with zero margins as wide as the window's radius and more
//   loss_gradient  maps, image, target -> v_image
//   loss_total     sums of the tiles -> the eight numbers of the stage
// `masked`: pixels whose mask is 0 are what lies outside of the image (kernels/opencl/loss.cl).
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/cuda_kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "kernels/math/appearance.h"
#include "kernels/map/row_sums.cl"
#include "kernels/map/appearance.cl"
#include "kernels/map/appearance_step.cl"
// clang-format on

constexpr int kThreads = static_cast<int>(kLossBlock);
constexpr int kTaps = kSsimTaps, kRadius = kSsimRadius;
constexpr int kStrip = 4;  // rows that one thread sums at once in the column pass, from kStrip + 10 rows
constexpr int kColumns = kLossTileX + 2 * kRadius, kRows = kLossTileY + 2 * kRadius;
constexpr int kPlane = kLossTileY * kColumns;
static_assert(kRadius == kLossRadius && kLossTileY % kStrip == 0);

__constant__ const float kWindow[kTaps] = UBS_SSIM_WEIGHTS;

// One channel. The target is 8 bit where `bytes` is given, else float; its planes are not padded.
struct Pixels {
  const float* image;
  const u8* bytes;
  const float* values;
  const u8* mask;  // of all channels
  int width, height, pitch;
};
__device__ __forceinline__ Pixels channel_pixels(const float* image, const u8* target,
                                                 const float* target_float, const u8* mask, int width,
                                                 int height, int pitch, int rows, int channel) {
  const size_t plane = static_cast<size_t>(channel) * width * height;
  return {image + static_cast<size_t>(channel) * pitch * rows,
          target ? target + plane : nullptr,
          target_float ? target_float + plane : nullptr,
          mask,
          width,
          height,
          pitch};
}
__device__ __forceinline__ float target_at(const Pixels& p, int x, int y) {
  const size_t i = static_cast<size_t>(y) * p.width + x;
  return p.bytes ? static_cast<float>(p.bytes[i]) * 0.00392156862745098f : p.values[i];
}

template <bool masked>
__device__ __forceinline__ bool pixel_counts(const Pixels& p, int x, int y) {
  const bool inside = x >= 0 && x < p.width && y >= 0 && y < p.height;
  if (!masked) return inside;
  return inside && p.mask[static_cast<size_t>(y) * p.width + x] != 0;
}

struct Pair {
  float u, v;
};
// What does not count is zero.
template <bool masked>
__device__ __forceinline__ Pair load_pair(const Pixels& p, int x, int y, float shift, float low, float high) {
  const bool inside = pixel_counts<masked>(p, x, y);
  float image = inside ? p.image[static_cast<size_t>(y) * p.pitch + x] : 0.0f;
  const float target = inside ? target_at(p, x, y) : 0.0f;
  image = image < low ? low : image;
  image = image > high ? high : image;
  return {(image - shift) + (target - shift), image - target};
}

struct WindowShared {
  float u[kRows * kColumns], v[kRows * kColumns];
  float means[4 * kPlane];
};

__device__ __forceinline__ void sum_columns(WindowShared& s, int thread) {
  for (int item = thread; item < kLossTileY / kStrip * kColumns; item += kThreads) {
    const int row = item / kColumns * kStrip, column = item % kColumns;
    float sum_u[kStrip] = {}, sum_v[kStrip] = {}, sum_uu[kStrip] = {}, sum_vv[kStrip] = {};
#pragma unroll
    for (int t = 0; t < kStrip + 2 * kRadius; ++t) {
      const float u = s.u[(row + t) * kColumns + column], v = s.v[(row + t) * kColumns + column];
      const float uu = u * u, vv = v * v;
#pragma unroll
      for (int k = 0; k < kStrip; ++k) {
        if (t < k || t - k >= kTaps) continue;
        const float w = kWindow[t - k];
        sum_u[k] += w * u;
        sum_v[k] += w * v;
        sum_uu[k] += w * uu;
        sum_vv[k] += w * vv;
      }
    }
#pragma unroll
    for (int k = 0; k < kStrip; ++k) {
      float* out = s.means + (row + k) * kColumns + column;
      out[0] = sum_u[k];
      out[kPlane] = sum_v[k];
      out[2 * kPlane] = sum_uu[k];
      out[3 * kPlane] = sum_vv[k];
    }
  }
}

__device__ __forceinline__ SsimMeans sum_row(const float* means) {
  SsimMeans m = {0.0f, 0.0f, 0.0f, 0.0f};
#pragma unroll
  for (int k = 0; k < kTaps; ++k) {
    const float w = kWindow[k];
    m.u += w * means[k];
    m.v += w * means[kPlane + k];
    m.uu += w * means[2 * kPlane + k];
    m.vv += w * means[3 * kPlane + k];
  }
  return m;
}

// Sum over the block in a fixed order; valid in thread 0.
__device__ __forceinline__ float block_sum(float value, float* scratch, int thread) {
#pragma unroll
  for (int distance = 16; distance > 0; distance /= 2) value += __shfl_xor_sync(0xffffffffu, value, distance);
  if (thread % 32 == 0) scratch[thread / 32] = value;
  __syncthreads();
  float sum = 0.0f;
  for (int warp = 0; warp < kThreads / 32; ++warp) sum += scratch[warp];
  __syncthreads();
  return sum;
}

// tile_sums: |I - T|, 1 - SSIM, (I - T)^2 of the tile.
template <bool gradient, bool masked>
__global__ void __launch_bounds__(kThreads)
    loss_window(const float* image, const u8* target, const float* target_float, int width, int height,
                int pitch, int rows, float low, float high, float* maps, int map_pitch, int map_plane,
                float* tile_sums, const u8* mask) {
  __shared__ WindowShared s;
  __shared__ float scratch[kThreads / 32];
  const int thread = static_cast<int>(threadIdx.x), channel = static_cast<int>(blockIdx.z);
  const int x0 = static_cast<int>(blockIdx.x) * kLossTileX, y0 = static_cast<int>(blockIdx.y) * kLossTileY;
  const Pixels p = channel_pixels(image, target, target_float, mask, width, height, pitch, rows, channel);
  // Target in the middle of the tile: near the pixels' value wherever they vary little, and only there does
  // the choice matter (see SsimMeans). What does not count must not choose.
  const int middle_x = x0 + kLossTileX / 2 < width ? x0 + kLossTileX / 2 : width - 1;
  const int middle_y = y0 + kLossTileY / 2 < height ? y0 + kLossTileY / 2 : height - 1;
  const float shift =
      masked && !pixel_counts<masked>(p, middle_x, middle_y) ? 0.5f : target_at(p, middle_x, middle_y);

  for (int item = thread; item < kRows * kColumns; item += kThreads) {
    const int row = item / kColumns, column = item % kColumns;
    const Pair pair = load_pair<masked>(p, x0 + column - kRadius, y0 + row - kRadius, shift, low, high);
    s.u[item] = pair.u;
    s.v[item] = pair.v;
  }
  __syncthreads();
  sum_columns(s, thread);
  __syncthreads();

  float sum_l1 = 0.0f, sum_ssim = 0.0f, sum_square = 0.0f;
  for (int item = thread; item < kLossTileY * kLossTileX; item += kThreads) {
    const int row = item / kLossTileX, column = item % kLossTileX;
    const SsimPoint point = ssim_point(sum_row(s.means + row * kColumns + column), shift);
    const float difference = s.v[(row + kRadius) * kColumns + column + kRadius];
    const bool inside = pixel_counts<masked>(p, x0 + column, y0 + row);
    sum_l1 += inside ? fabsf(difference) : 0.0f;
    sum_ssim += inside ? point.dissimilarity : 0.0f;
    sum_square += inside ? difference * difference : 0.0f;
    if (gradient && x0 + column < pitch) {
      float* map = maps + static_cast<size_t>(channel) * 3 * map_plane +
                   static_cast<size_t>(y0 + row + kRadius) * map_pitch + kLossMapMargin + x0 + column;
      map[0] = inside ? point.mean : 0.0f;
      map[map_plane] = inside ? point.square_u : 0.0f;
      map[2 * static_cast<size_t>(map_plane)] = inside ? point.square_v : 0.0f;
    }
  }
  const float l1 = block_sum(sum_l1, scratch, thread), ssim = block_sum(sum_ssim, scratch, thread),
              square = block_sum(sum_square, scratch, thread);
  if (thread > 0) return;
  float* out =
      tile_sums + ((static_cast<size_t>(channel) * gridDim.y + blockIdx.y) * gridDim.x + blockIdx.x) * 4;
  out[0] = l1;
  out[1] = ssim;
  out[2] = square;
}

// The maps' zero margins stand for the padding.
template <bool masked>
__global__ void __launch_bounds__(kThreads)
    loss_gradient(const float* image, const u8* target, const float* target_float, int width, int height,
                  int pitch, int rows, float weight_l1, float weight_ssim, const float* maps, int map_pitch,
                  int map_plane, float* v_image, const u8* mask) {
  __shared__ float sums[3 * kPlane];
  const int thread = static_cast<int>(threadIdx.x), channel = static_cast<int>(blockIdx.z);
  const int x0 = static_cast<int>(blockIdx.x) * kLossTileX, y0 = static_cast<int>(blockIdx.y) * kLossTileY;
  const Pixels p = channel_pixels(image, target, target_float, mask, width, height, pitch, rows, channel);
  const LossWeights weights = {weight_l1, weight_ssim};

  for (int item = thread; item < kLossTileY / kStrip * kColumns; item += kThreads) {
    const int row = item / kColumns * kStrip, column = item % kColumns;
    if (x0 + column - kRadius >= pitch + kRadius) continue;  // beyond what the last tile of a row reads
    const float* map = maps + static_cast<size_t>(channel) * 3 * map_plane +
                       static_cast<size_t>(y0 + row) * map_pitch + kLossMapMargin + x0 - kRadius + column;
    float sum[3][kStrip] = {};
#pragma unroll
    for (int t = 0; t < kStrip + 2 * kRadius; ++t) {
#pragma unroll
      for (int m = 0; m < 3; ++m) {
        const float value = map[static_cast<size_t>(t) * map_pitch + m * static_cast<size_t>(map_plane)];
#pragma unroll
        for (int k = 0; k < kStrip; ++k)
          if (t >= k && t - k < kTaps) sum[m][k] += kWindow[t - k] * value;
      }
    }
#pragma unroll
    for (int m = 0; m < 3; ++m)
#pragma unroll
      for (int k = 0; k < kStrip; ++k) sums[m * kPlane + (row + k) * kColumns + column] = sum[m][k];
  }
  __syncthreads();

  for (int item = thread; item < kLossTileY * kLossTileX; item += kThreads) {
    const int row = item / kLossTileX, column = item % kLossTileX;
    if (x0 + column >= pitch) continue;
    const float* sum = sums + row * kColumns + column;
    float mean = 0.0f, square_u = 0.0f, square_v = 0.0f;
#pragma unroll
    for (int k = 0; k < kTaps; ++k) {
      mean += kWindow[k] * sum[k];
      square_u += kWindow[k] * sum[kPlane + k];
      square_v += kWindow[k] * sum[2 * kPlane + k];
    }
    const Pair pair = load_pair<masked>(p, x0 + column, y0 + row, 0.0f, -UBS_REAL_MAX, UBS_REAL_MAX);
    const float gradient = image_loss_vjp(weights, pair.u, pair.v, mean, square_u, square_v);
    const bool inside = pixel_counts<masked>(p, x0 + column, y0 + row);
    v_image[(static_cast<size_t>(channel) * rows + y0 + row) * pitch + x0 + column] =
        inside ? gradient : 0.0f;
  }
}

struct Compensated {
  float sum, lost;  // lost: what rounding has taken from the sum so far (Kahan)
};
__device__ __forceinline__ Compensated add_share(Compensated s, float share) {
  const float corrected = __fsub_rn(share, s.lost);
  const float next = __fadd_rn(s.sum, corrected);
  s.lost = __fsub_rn(__fsub_rn(next, s.sum), corrected);
  s.sum = next;
  return s;
}

// One block, 64 threads for each of the nine sums: thread i of them adds tiles i, i + 64, ..., then one adds
// the 64. The order is that of kernels/opencl/loss.cl.
constexpr int kShares = 64, kQuantities = 9;  // channel * 3 + quantity
static_assert(kShares * kQuantities == static_cast<int>(kLossTotalBlock));
__global__ void __launch_bounds__(kLossTotalBlock)
    loss_total(const float* tile_sums, int tiles, float pixels, float* sums, u32 sums_offset) {
  __shared__ float shares[kQuantities * (kShares + 1)], totals[kQuantities];
  const int me = static_cast<int>(threadIdx.x), q = me / kShares, share = me % kShares;
  Compensated mine = {0.0f, 0.0f};
  for (int tile = share; tile < tiles; tile += kShares)
    mine = add_share(mine, tile_sums[(static_cast<size_t>(q / 3) * tiles + tile) * 4 + q % 3]);
  shares[q * (kShares + 1) + share] = mine.sum;
  __syncthreads();
  if (me < kQuantities) {
    Compensated s = {0.0f, 0.0f};
    for (int i = 0; i < kShares; ++i) s = add_share(s, shares[me * (kShares + 1) + i]);
    totals[me] = s.sum / pixels;
  }
  __syncthreads();
  if (me > 0) return;
  float* out = sums + sums_offset;
  out[0] = (totals[0] + totals[3] + totals[6]) / 3.0f;
  out[1] = 1.0f - (totals[1] + totals[4] + totals[7]) / 3.0f;
  for (int c = 0; c < 3; ++c) out[2 + c] = totals[3 * c + 2];
  for (int i = 5; i < 8; ++i) out[i] = 0.0f;
}

}  // namespace

AppearanceTable appearance_kernels() {
  return {map_colours, map_colours_vjp, row_sums, appearance_gradient, appearance_step};
}

LossKernels loss_kernels(bool masked) {
  if (masked) return {loss_window<false, true>, loss_window<true, true>, loss_gradient<true>, loss_total};
  return {loss_window<false, false>, loss_window<true, false>, loss_gradient<false>, loss_total};
}

}  // namespace ubs::cuda
