// SPDX-License-Identifier: Apache-2.0
// The kernels of the CUDA back end as typed function pointers: what the .cu files offer to the host code.
// A pointer is the handle that cudaLaunchKernel takes; the types let the compiler check every launch.
#pragma once

#include <cstdint>

namespace ubs::cuda {

using u8 = std::uint8_t;
using u16 = std::uint16_t;
using u32 = std::uint32_t;
using u64 = unsigned long long;

// kernels/map, one thread an element, compiled once for each number of dimensions (map_kernels.cu).
struct ProjectKernels {
  void (*forward)(const float* params, u32 count, u32 stride, u32 first_record, const float* cameras,
                  u32 camera, float near_plane, float far_plane, float eps2d, float* records, u32* depth_keys,
                  u32* tile_rects, u32* tile_counts);
  void (*backward)(const float* params, u32 count, u32 stride, u32 first_record, const float* cameras,
                   u32 camera, float near_plane, float far_plane, float eps2d, const float* v_records, float* v_params,
                   u32 accumulate);
};
struct ParameterKernels {
  void (*adam)(float* params, const float* v_params, float* moment1, float* moment2,
               const float* learning_rates, u32 count, u32 stride, float beta1, float beta2, float epsilon,
               float inverse_bias1, float inverse_sqrt_bias2);
  void (*adam_watched)(float* params, const float* v_params, float* moment1, float* moment2,
                       const float* learning_rates, u32 count, u32 stride, float beta1, float beta2, float epsilon,
                       float inverse_bias1, float inverse_sqrt_bias2, u32* sentinel, u32 stamp);
  void (*regularise)(const float* params, float* v_params, u32 count, u32 stride, float opacity_weight,
                     float scale_weight);
  void (*add_noise)(float* params, u32 count, u32 stride, float amount, u32 seed0, u32 seed1, u32 iteration0,
                    u32 iteration1);
  void (*mcmc_weights)(const float* params, u32 count, u32 stride, u32 alive_only, u32* weights, u32* copies);
  void (*mcmc_sources)(float* params, u32 count, u32 stride, const u32* copies, float* moment1,
                       float* moment2);
  void (*mcmc_copies)(float* params, u32 stride, u32 first, u32 slots, const u32* sources, float* moment1,
                      float* moment2);
};
// dim 3 .. 11.
ProjectKernels project_kernels(int dim, bool query_grad);
ParameterKernels parameter_kernels(int dim);
constexpr unsigned kMapBlock = 128;

// raster_kernels.cu: one block of 256 threads a tile; sum_slots: 16 threads a splat.
constexpr unsigned kTileBlock = 256, kSumBlock = 256;
struct RasterKernels {
  void (*forward)(const float* records, const u32* sorted_ids, const u32* sorted_slots,
                  const u32* tile_ranges, int tiles_x, int tiles_y, int width, int height, float background_r,
                  float background_g, float background_b, float* image, float* transmittance, float* depth,
                  u16* masks);
  void (*backward)(const float* records, const u32* sorted_ids, const u32* sorted_slots,
                   const u32* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                   const float* image, const float* v_image, const u16* masks, float* slots);
  void (*sum_slots)(u32 count, const u32* tile_counts, const u32* slot_offsets, const float* slots,
                    const u16* masks, float* v_records);
};
RasterKernels raster_kernels(bool depth);

// loss_kernels.cu: one block a tile of one channel, grid (tiles across, tiles down, 3).
constexpr unsigned kLossBlock = 256, kLossTotalBlock = 64;
constexpr int kLossTileX = 32, kLossTileY = 16, kLossRadius = 5, kLossMapMargin = 16;
struct LossKernels {
  using Window = void (*)(const float* image, const u8* target, const float* target_float, int width,
                          int height, int pitch, int rows, float low, float high, float* maps, int map_pitch,
                          int map_plane, float* tile_sums, const u8* mask);
  Window window, window_with_maps;
  void (*gradient)(const float* image, const u8* target, const float* target_float, int width, int height,
                   int pitch, int rows, float weight_l1, float weight_ssim, const float* maps, int map_pitch,
                   int map_plane, float* v_image, const u8* mask);
  void (*total)(const float* tile_sums, int tiles, float pixels, float* sums, u32 sums_offset);
};
LossKernels loss_kernels(bool masked);  // without: the mask is not looked at

// metric_kernels.cu, one thread an element.
struct MetricKernels {
  void (*load_image)(const u8* bytes, const float* values, int width, int height, int pitch, int rows, float scale_r,
                     float scale_g, float scale_b, float offset_r, float offset_g, float offset_b, int plane,
                     float* out);
  void (*im2col)(const float* image, int width, int height, int plane, int window, int stride, int padding,
                 int out_width, int first, int count, int pitch, float* matrix);
  void (*bias_relu)(float* features, int first, const float* bias, int plane);
  void (*max_pool)(const float* image, int width, int height, int plane, int window, int stride, int out_width,
                   int out_height, int out_plane, float* out);
  void (*lpips_distance)(const float* a, const float* b, const float* weights, int channels, int pixels, int plane,
                         float* distances);
  void (*partial_sums)(const float* values, int first, int count, int items, int sums_offset, float* sums);
  void (*ssim_rows)(const float* a, const float* b, int first, int width, int height, int pitch, float* sums);
  void (*ssim_columns)(float* sums, int width, int height, int pitch, int results);
};
MetricKernels metric_kernels();

// list_kernels.cu, one thread an element.
struct SplatCounts {  // running totals over the splats of a view
  u64 tiles, drawn;
};
constexpr unsigned kListBlock = 256;
struct ListKernels {
  void (*write_counts)(const u32* tile_counts, u32 count, const SplatCounts* before, u32* visible_ids,
                       u32* slot_offsets, u64* totals);
  void (*gather_keys)(const u32* visible_ids, u32 count, const u32* depth_keys, u32* keys);
  void (*gather_areas)(const u32* order, u32 count, const u32* tile_rects, u32* areas);
  void (*emit)(const u32* order, const u32* firsts, u32 count, u32 intersections, const u32* tile_rects,
               u32 tiles_x, u32* tiles, u32* ids);
  void (*finish)(const u32* tiles_sorted, const u32* ids, u32 intersections, u32 tiles, u32 tiles_x,
                 const u32* tile_rects, const u32* slot_offsets, u32* slots, u32* tile_ranges);
};
ListKernels list_kernels();

// mcmc_kernels.cu, one thread a slot.
struct McmcKernels {
  void (*draw)(const u64* prefix, const u32* weights, u32 count, u32 slots, u32 purpose, u32 seed0, u32 seed1,
               u32 iteration0, u32 iteration1, u32* sources, u32* copies, u32* totals);
};
McmcKernels mcmc_kernels();

}  // namespace ubs::cuda
