// SPDX-License-Identifier: Apache-2.0
// Declares the kernels of the CUDA back end with the types of their arguments, so that the compiler checks
// every launch. A kernel is either compiled ahead of time in one of the .cu files, or belongs to a program
// that is compiled at run time.
#pragma once

#include <vector>

#include "host/device/map_kernels.hpp"
#include "kernels/limits.h"

namespace ubs::cuda {

// Kernel is either a symbol that was compiled ahead of time, or a function of a Module
// (cuda_backend/module.hpp).
template <typename Signature>
struct Kernel;
template <typename... Parameters>
struct Kernel<void(Parameters...)> {
  Kernel() = default;
  Kernel(void (*compiled)(Parameters...)) : symbol(compiled) {}

  void (*symbol)(Parameters...) = nullptr;
  void* function = nullptr;
};

// KernelTable is a set of kernels with different signatures. A kernel is found by its signature.
template <typename... Signatures>
struct KernelTable : Kernel<Signatures>... {};

// These are the kernels of kernels/map that depend on the number of dimensions, and are therefore compiled
// once for each number (map_kernels.cu). They have one thread per element, except for the kernel of the
// camera gradient, whose number of threads is CameraBackward::lanes.
struct ProjectKernels {
  Kernel<ProjectForwardKernel> forward;
  Kernel<ProjectBackwardKernel> backward;
};
struct CameraKernels {
  Kernel<CameraBackwardKernel> backward;
};
using ParameterKernels =
    KernelTable<AdamKernel, WatchedAdamKernel, RegulariseKernel, AddNoiseKernel, McmcWeightsKernel,
                McmcDrawKernel, McmcSourcesKernel, McmcCopiesKernel, McmcPlacesKernel>;
// The default variant is compiled ahead of time up to this number of dimensions, which covers common data.
// Kernels for more dimensions are compiled at run time. The kernel of the camera gradient and projection
// kernels with gradients through the view direction are compiled at run time for any number of dimensions.
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

// RasterKernels contains the kernels of raster_kernels.cu. The rasterisers have one thread per pixel of a
// tile. sum_slots has 16 threads per splat.
constexpr unsigned kSumBlock = 256;
struct RasterKernels {
  Kernel<RasterPartsKernel> parts;
  Kernel<RasterForwardKernel> forward;
  Kernel<RasterJoinKernel> join;
  Kernel<void(const float* records, const u32* sorted_ids, const u32* sorted_slots, const u32* tile_ranges,
              int tiles_x, int tiles_y, int width, int height, const float* image, const float* v_image,
              const u16* masks, const float* states, const float* more_colours, const float* v_more,
              int more_channels, float* slots)>
      backward;
  Kernel<void(u32 count, const u32* tile_counts, const u32* slot_offsets, const float* slots,
              const u16* masks, float* v_records)>
      sum_slots;
};
struct WeightKernels {
  Kernel<MeasureWeightsKernel> measure;
};
// These functions return kernels of the default variant. The kernels that raster_kernels_depth() returns also
// write the depth image. Functions named ..._plain return kernels that do not.
RasterKernels raster_kernels_plain();
RasterKernels raster_kernels_depth();
WeightKernels weight_kernels_plain();

// LossKernels contains the kernels of kernels/gpu/loss.cl, which loss_kernels.cu compiles. The window and
// gradient kernels have one block per tile of one channel. The margins kernel has one block per row of each
// map, and the total kernel has a single block.
constexpr unsigned kLossBlock = 128, kLossTotalBlock = 192;
constexpr int kLossTileX = 32;
struct LossKernels {
  Kernel<LossMarginsKernel> margins;
  Kernel<LossWindowKernel> window;
  Kernel<LossGradientKernel> gradient;
  Kernel<LossTotalKernel> total;
};
// Returns the kernels that take the mask of the target image into account, or, if with_mask is false, kernels
// for images without a mask.
LossKernels loss_kernels(bool with_mask);

// AppearanceTable contains the kernels of kernels/map/appearance.cl and appearance_step.cl, which
// loss_kernels.cu compiles. They have one thread per element.
using AppearanceTable = KernelTable<MapColoursKernel, MapColoursVjpKernel, RowSumsKernel,
                                    AppearanceGradientKernel, AppearanceStepKernel>;
AppearanceTable appearance_kernels();

// SkyTable contains the kernels of kernels/map/sky.cl and sky_step.cl, which sky_kernels.cu compiles. They
// have one thread per element.
using SkyTable = KernelTable<DrawSkyKernel, SkyVjpKernel, RowSumsKernel, SkyGradientKernel, SkyStepKernel>;
SkyTable sky_kernels();

// ImageGradientTable contains the kernels of kernels/map/image_gradient.cl, which loss_kernels.cu compiles.
using ImageGradientTable = KernelTable<AlphaToColoursKernel, DepthSumsKernel, RowSumsKernel, DepthMeanKernel,
                                       DepthToRecordsKernel, DepthToImageKernel, DepthFromRecordsKernel>;
ImageGradientTable image_gradient_kernels();

// DrawnTable contains the kernels of kernels/map/drawn.cl, which list_kernels.cu compiles. They have one
// thread per element.
using DrawnTable = KernelTable<MarkDrawnKernel, PickDrawnKernel, UnpackDrawnKernel, SpreadGradientKernel>;
DrawnTable drawn_kernels();

// MetricKernels contains the kernels of metric_kernels.cu. They have one thread per element.
using MetricKernels = KernelTable<LoadImageKernel, Im2colKernel, BiasReluKernel, MaxPoolKernel,
                                  LpipsDistanceKernel, PartialSumsKernel, SsimRowsKernel, SsimColumnsKernel>;
MetricKernels metric_kernels();

// ListKernels contains the kernels of list_kernels.cu that build the tile lists. They have one thread per
// element. TileKernels contains those that depend on the type of the keys of the sort by tile, u16 or u32.
constexpr unsigned kListBlock = 256;
template <typename Key>
struct TileKernels {
  Kernel<void(const u32* order, const u32* firsts, u32 most_drawn, const u32* drawn, u32 most_pairs,
              const u32* pairs, const u32* tile_rects, u32 tiles_x, Key* tiles, u32* ids, u32* long_lists)>
      emit;
  Kernel<void(const Key* tiles_sorted, const u32* ids, u32 most_pairs, const u32* pairs, u32 tiles,
              u32 tiles_x, const u32* tile_rects, const u32* slot_offsets, u32* slots, u32* tile_ranges,
              u32* long_lists)>
      finish;
};
struct ListKernels {
  Kernel<void(const u32* tile_counts, const u32* depth_keys, u32 count, u32 bits, const u64* before,
              u32* visible_ids, u32* keys, u32* slot_offsets, u64* totals)>
      write_counts;
  Kernel<FitListsKernel> fit;
  Kernel<void(const u32* order, u32 most, const u32* counted, const u32* tile_rects, u32* areas)>
      gather_areas;
  TileKernels<u16> narrow;
  TileKernels<u32> wide;
};
ListKernels list_kernels();
// Returns the compute capabilities that the kernels were compiled for, in ascending order, for example 90 for
// sm_90.
std::vector<int> compiled_capabilities();

}  // namespace ubs::cuda
