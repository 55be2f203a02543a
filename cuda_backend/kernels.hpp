// SPDX-License-Identifier: Apache-2.0
// The kernels of the CUDA back end with the types of their arguments, so that the compiler checks every
// launch: what the .cu files offer to the host code, and the same kernels in programs that are compiled at
// run time.
#pragma once

#include <cstdint>
#include <vector>

namespace ubs::cuda {

using u8 = std::uint8_t;
using u16 = std::uint16_t;
using u32 = std::uint32_t;
using u64 = unsigned long long;

// Either a symbol that was compiled ahead of time, or a function of a Module (cuda_backend/module.hpp).
template <typename Signature>
struct Kernel;
template <typename... Parameters>
struct Kernel<void(Parameters...)> {
  Kernel() = default;
  Kernel(void (*compiled)(Parameters...)) : symbol(compiled) {}

  void (*symbol)(Parameters...) = nullptr;
  void* function = nullptr;
};

// kernels/map, one thread an element, compiled once for each number of dimensions (map_kernels.cu).
struct ProjectKernels {
  Kernel<void(const float* params, u32 count, u32 stride, u32 first_record, const float* cameras, u32 camera,
              float near_plane, float far_plane, float eps2d, float* records, u32* depth_keys,
              u32* tile_rects, u32* tile_counts)>
      forward;
  Kernel<void(const float* params, u32 count, u32 stride, u32 first_record, const float* cameras, u32 camera,
              float near_plane, float far_plane, float eps2d, const float* v_records, float* v_params,
              u32 accumulate)>
      backward;
};
struct CameraKernels {
  Kernel<void(const float* params, u32 count, u32 stride, u32 first_record, const float* cameras, u32 camera,
              float near_plane, float far_plane, float eps2d, const float* v_records, float* v_camera,
              u32 lanes)>
      backward;
};
struct ParameterKernels {
  Kernel<void(float* params, const float* v_params, float* moment1, float* moment2,
              const float* learning_rates, u32 count, u32 stride, float beta1, float beta2, float epsilon,
              float inverse_bias1, float inverse_sqrt_bias2)>
      adam;
  Kernel<void(float* params, const float* v_params, float* moment1, float* moment2,
              const float* learning_rates, u32 count, u32 stride, float beta1, float beta2, float epsilon,
              float inverse_bias1, float inverse_sqrt_bias2, u32* sentinel, u32 stamp)>
      adam_watched;
  Kernel<void(const float* params, float* v_params, u32 count, u32 stride, float opacity_weight,
              float scale_weight)>
      regularise;
  Kernel<void(float* params, u32 count, u32 stride, float amount, u32 seed0, u32 seed1, u32 iteration0,
              u32 iteration1)>
      add_noise;
  Kernel<void(const float* params, u32 count, u32 stride, u32 alive_only, u32* weights, u32* copies)>
      mcmc_weights;
  Kernel<void(float* params, u32 count, u32 stride, const u32* copies, float* moment1, float* moment2)>
      mcmc_sources;
  Kernel<void(float* params, u32 stride, u32 first, u32 slots, const u32* sources, float* moment1,
              float* moment2)>
      mcmc_copies;
};
// Of the default form; dim 3 .. 11.
ProjectKernels compiled_project_kernels(int dim, bool query_grad);
CameraKernels compiled_camera_kernels(int dim);
ParameterKernels compiled_parameter_kernels(int dim);
constexpr unsigned kMapBlock = 128;

// raster_kernels.cu: one block a tile, one thread a pixel; sum_slots: 16 threads a splat.
constexpr unsigned kSumBlock = 256;
struct RasterKernels {
  Kernel<void(const float* records, const u32* sorted_ids, const u32* sorted_slots, const u32* tile_ranges,
              int tiles_x, int tiles_y, int width, int height, float background_r, float background_g,
              float background_b, float* image, float* transmittance, float* depth, u16* masks)>
      forward;
  Kernel<void(const float* records, const u32* sorted_ids, const u32* sorted_slots, const u32* tile_ranges,
              int tiles_x, int tiles_y, int width, int height, const float* image, const float* v_image,
              const u16* masks, float* slots)>
      backward;
  Kernel<void(u32 count, const u32* tile_counts, const u32* slot_offsets, const float* slots,
              const u16* masks, float* v_records)>
      sum_slots;
};
struct WeightKernels {
  Kernel<void(const float* records, const u32* sorted_ids, const u32* sorted_slots, const u32* tile_ranges,
              int tiles_x, int tiles_y, int width, int height, const u16* masks, const u32* partners,
              const float* others, float* weights, float* changes, float* stops)>
      measure;
};
// Of the default form: without and with depth.
RasterKernels raster_kernels_plain();
RasterKernels raster_kernels_depth();
WeightKernels weight_kernels_plain();

// loss_kernels.cu: one block a tile of one channel, grid (tiles across, tiles down, 3).
constexpr unsigned kLossBlock = 256, kLossTotalBlock = 9 * 64;
constexpr int kLossTileX = 32, kLossTileY = 16, kLossRadius = 5, kLossMapMargin = 16;
struct LossKernels {
  using Window = Kernel<void(const float* image, const u8* target, const float* target_float, int width,
                             int height, int pitch, int rows, float low, float high, float* maps,
                             int map_pitch, int map_plane, float* tile_sums, const u8* mask)>;
  Window window, window_with_maps;
  Kernel<void(const float* image, const u8* target, const float* target_float, int width, int height,
              int pitch, int rows, float weight_l1, float weight_ssim, const float* maps, int map_pitch,
              int map_plane, float* v_image, const u8* mask)>
      gradient;
  Kernel<void(const float* tile_sums, int tiles, float pixels, float* sums, u32 sums_offset)> total;
};
LossKernels loss_kernels(bool masked);  // without: the mask is not looked at

// loss_kernels.cu as well, one thread an element: kernels/map/appearance.cl and appearance_step.cl.
struct AppearanceTable {
  Kernel<void(const float* image, u32 plane, const float* numbers, u32 first, float* mapped)> map;
  Kernel<void(const float* image, int width, int height, int pitch, int rows, const float* numbers, u32 first,
              float* v_image, float* sums)>
      map_vjp;
  Kernel<void(float* sums, int pitch, int count)> row_sums;
  Kernel<void(const float* sums, int pitch, int strips, const float* numbers, u32 first, float* gradient,
              u32 first_gradient)>
      gradient;
  Kernel<void(float* state, u32 images, u32 image, const float* gradient, u32 first_gradient,
              float rate_diagonal, float rate_other, float beta1, float beta2, float epsilon, u32* sentinel,
              u32 stamp)>
      step;
};
AppearanceTable appearance_kernels();

// metric_kernels.cu, one thread an element.
struct MetricKernels {
  Kernel<void(const u8* bytes, const float* values, int width, int height, int pitch, int rows, float scale_r,
              float scale_g, float scale_b, float offset_r, float offset_g, float offset_b, int plane,
              float* out)>
      load_image;
  Kernel<void(const float* image, int width, int height, int plane, int window, int stride, int padding,
              int out_width, int first, int count, int pitch, float* matrix)>
      im2col;
  Kernel<void(float* features, int first, const float* bias, int plane)> bias_relu;
  Kernel<void(const float* image, int width, int height, int plane, int window, int stride, int out_width,
              int out_height, int out_plane, float* out)>
      max_pool;
  Kernel<void(const float* a, const float* b, const float* weights, int channels, int pixels, int plane,
              float* distances)>
      lpips_distance;
  Kernel<void(const float* values, int first, int count, int items, int sums_offset, float* sums)>
      partial_sums;
  Kernel<void(const float* a, const float* b, int first, int width, int height, int pitch, float* sums)>
      ssim_rows;
  Kernel<void(float* sums, int width, int height, int pitch, int results)> ssim_columns;
};
MetricKernels metric_kernels();

// ceiling_kernels.cu, in blocks of any size that divides the threads.
struct CeilingFunctions {
  Kernel<void(float* out, u32 rounds, float factor)> fma;
  Kernel<void(const float* in, float* out, u32 spacing, u32 step, u32 count, u32 rounds)> read;
  Kernel<void(float* out, u32 spacing, u32 step, u32 count, float value)> write;
  Kernel<void(float* inout, u32 spacing, u32 step, u32 count, float value, u32 rounds)> update;
};
CeilingFunctions ceiling_functions();

// list_kernels.cu, one thread an element.
constexpr unsigned kListBlock = 256;
// A number of elements: `most`, or, bounded, what stands at `counted`, which is no more (null otherwise).
struct ListKernels {
  Kernel<void(const u32* tile_counts, const u32* depth_keys, u32 count, u32 bits, const u64* before,
              u32* visible_ids, u32* keys, u32* slot_offsets, u64* totals)>
      write_counts;
  Kernel<void(const u64* totals, u64 room, u32 count, u32* tile_counts, u32* drawn, u32* pairs)> fit;
  Kernel<void(const u32* order, u32 most, const u32* counted, const u32* tile_rects, u32* areas)>
      gather_areas;
  Kernel<void(const u32* order, const u32* firsts, u32 most_drawn, const u32* drawn, u32 most_pairs,
              const u32* pairs, const u32* tile_rects, u32 tiles_x, u32* tiles, u32* ids)>
      emit;
  Kernel<void(const u32* tiles_sorted, const u32* ids, u32 most_pairs, const u32* pairs, u32 tiles,
              u32 tiles_x, const u32* tile_rects, const u32* slot_offsets, u32* slots, u32* tile_ranges)>
      finish;
};
ListKernels list_kernels(bool bounded);
// That the kernels were compiled for, ascending: 90 for sm_90.
std::vector<int> compiled_capabilities();

// mcmc_kernels.cu, one thread a slot.
struct McmcKernels {
  Kernel<void(const u64* prefix, const u32* weights, u32 count, u32 slots, u32 purpose, u32 seed0, u32 seed1,
              u32 iteration0, u32 iteration1, u32* sources, u32* copies, u32* totals)>
      draw;
};
McmcKernels mcmc_kernels();

}  // namespace ubs::cuda
