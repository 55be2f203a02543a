// SPDX-License-Identifier: Apache-2.0
// The kernels of the CUDA back end with the types of their arguments, so that the compiler checks every
// launch. They are either compiled ahead of time in the .cu files, or belong to programs that are compiled at
// run time.
#pragma once

#include <vector>

#include "host/device/map_kernels.hpp"
#include "kernels/limits.h"

namespace ubs::cuda {

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

// A set of kernels with different signatures. A kernel is found by its signature.
template <typename... Signatures>
struct KernelTable : Kernel<Signatures>... {};

// The kernels of kernels/map. They have one thread per element, and are compiled once for each number of
// dimensions (map_kernels.cu).
struct ProjectKernels {
  Kernel<ProjectForwardKernel> forward;
  Kernel<ProjectBackwardKernel> backward;
};
struct CameraKernels {
  Kernel<CameraBackwardKernel> backward;
};
using ParameterKernels = KernelTable<AdamKernel, WatchedAdamKernel, RegulariseKernel, AddNoiseKernel,
                                     McmcWeightsKernel, McmcDrawKernel, McmcSourcesKernel, McmcCopiesKernel>;
// The default variant is compiled ahead of time up to this number of dimensions, which covers common data.
// Kernels for more dimensions are compiled at run time. The same holds, for any number of dimensions, for the
// kernel of the camera gradient and for projection kernels with gradients through the view direction.
constexpr int kLastDimAhead = 7;
template <int dim>
ProjectKernels project_kernels_of();
template <int dim>
ParameterKernels parameter_kernels_of();
#define UBS_DECLARE(n)                    \
  template <>                             \
  ProjectKernels project_kernels_of<n>(); \
  template <>                             \
  ParameterKernels parameter_kernels_of<n>();
UBS_DECLARE(3)
UBS_DECLARE(4)
UBS_DECLARE(5)
UBS_DECLARE(6)
UBS_DECLARE(7)
#undef UBS_DECLARE
ProjectKernels compiled_project_kernels(int dim);
ParameterKernels compiled_parameter_kernels(int dim);
constexpr unsigned kMapBlock = 128;

// The kernels of raster_kernels.cu. The rasterisers have one thread per pixel of a tile. sum_slots has 16
// threads per splat.
constexpr unsigned kSumBlock = 256;
struct RasterKernels {
  Kernel<RasterPartsKernel> parts;
  Kernel<RasterForwardKernel> forward;
  Kernel<RasterJoinKernel> join;
  Kernel<void(const float* records, const u32* sorted_ids, const u32* sorted_slots, const u32* tile_ranges,
              int tiles_x, int tiles_y, int width, int height, const float* image, const float* v_image,
              const u16* masks, const float* states, float* slots)>
      backward;
  Kernel<void(u32 count, const u32* tile_counts, const u32* slot_offsets, const float* slots,
              const u16* masks, float* v_records)>
      sum_slots;
};
struct WeightKernels {
  Kernel<MeasureWeightsKernel> measure;
};
// Return kernels of the default variant. `plain` is without the output of depth, `depth` is with it.
RasterKernels raster_kernels_plain();
RasterKernels raster_kernels_depth();
WeightKernels weight_kernels_plain();

// The kernels of kernels/gpu/loss.cl, compiled in loss_kernels.cu. They have one block per tile of one
// channel.
constexpr unsigned kLossBlock = 128, kLossTotalBlock = 192;
constexpr int kLossTileX = 32;
struct LossKernels {
  Kernel<LossMarginsKernel> margins;
  Kernel<LossWindowKernel> window;
  Kernel<LossGradientKernel> gradient;
  Kernel<LossTotalKernel> total;
};
// Returns the kernels that read the mask of the image, or, if with_mask is false, kernels that do not.
LossKernels loss_kernels(bool with_mask);

// The kernels of kernels/map/appearance.cl and appearance_step.cl, also compiled in loss_kernels.cu. They
// have one thread per element.
using AppearanceTable = KernelTable<MapColoursKernel, MapColoursVjpKernel, RowSumsKernel,
                                    AppearanceGradientKernel, AppearanceStepKernel>;
AppearanceTable appearance_kernels();

// The kernels of kernels/map/sky.cl and sky_step.cl, compiled in sky_kernels.cu. They have one thread per
// element.
using SkyTable = KernelTable<DrawSkyKernel, SkyVjpKernel, RowSumsKernel, SkyGradientKernel, SkyStepKernel>;
SkyTable sky_kernels();

// The kernels of kernels/map/drawn.cl, compiled in list_kernels.cu. They have one thread per element.
using DrawnTable = KernelTable<MarkDrawnKernel, PickDrawnKernel, UnpackDrawnKernel, SpreadGradientKernel>;
DrawnTable drawn_kernels();

// The kernels of metric_kernels.cu. They have one thread per element.
using MetricKernels = KernelTable<LoadImageKernel, Im2colKernel, BiasReluKernel, MaxPoolKernel,
                                  LpipsDistanceKernel, PartialSumsKernel, SsimRowsKernel, SsimColumnsKernel>;
MetricKernels metric_kernels();

// The kernels of list_kernels.cu. They have one thread per element.
constexpr unsigned kListBlock = 256;
struct ListKernels {
  Kernel<void(const u32* tile_counts, const u32* depth_keys, u32 count, u32 bits, const u64* before,
              u32* visible_ids, u32* keys, u32* slot_offsets, u64* totals)>
      write_counts;
  Kernel<FitListsKernel> fit;
  Kernel<void(const u32* order, u32 most, const u32* counted, const u32* tile_rects, u32* areas)>
      gather_areas;
  Kernel<void(const u32* order, const u32* firsts, u32 most_drawn, const u32* drawn, u32 most_pairs,
              const u32* pairs, const u32* tile_rects, u32 tiles_x, u32* tiles, u32* ids, u32* long_lists)>
      emit;
  Kernel<void(const u32* tiles_sorted, const u32* ids, u32 most_pairs, const u32* pairs, u32 tiles,
              u32 tiles_x, const u32* tile_rects, const u32* slot_offsets, u32* slots, u32* tile_ranges,
              u32* long_lists)>
      finish;
};
ListKernels list_kernels();
// Returns the compute capabilities that the kernels were compiled for, in ascending order, for example 90 for
// sm_90.
std::vector<int> compiled_capabilities();

}  // namespace ubs::cuda
