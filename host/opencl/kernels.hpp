// SPDX-License-Identifier: Apache-2.0
// This header declares the kernels of the OpenCL back end with the types of their arguments. The additional
// arguments of core groups (core_groups.hpp) are not included. With UBS_SYNC=1, each declaration is compared
// with the types that the compiler of the driver reports.
#pragma once

#include <array>

#include "host/device/map_kernels.hpp"
#include "host/device/stages.hpp"

namespace ubs::opencl {

// The gradient slots of a kernel are the parameters that the macro UBS_SLOTS declares: eight buffers and a
// number.
using Slots = SlotViews;

// ---- kernels/map ----
inline constexpr Declared<ProjectForwardKernel> kProjectForward{"project_forward"};
inline constexpr Declared<ProjectBackwardKernel> kProjectBackward{"project_backward"};
inline constexpr Declared<CameraBackwardKernel> kCameraBackward{"camera_backward"};
inline constexpr Declared<void(float* params, u32 count, u32 stride, u32 first_record, const float* cameras,
                               u32 camera, float near_plane, float far_plane, float eps2d,
                               const float* v_records, const float* v_params, u32 accumulate,
                               PenaltyWeights penalty, float* moment1, float* moment2,
                               const float* learning_rates, float beta1, float beta2, float epsilon,
                               float inverse_bias1, float inverse_sqrt_bias2, u32* sentinel, u32 stamp)>
    kLearn{"project_backward_adam"};
inline constexpr Declared<FitListsKernel> kFitLists{"clamp_to_capacity"};

// ---- Rasterisers ----
inline constexpr Declared<void(const float* records, const u32* sorted_ids, const u32* sorted_slots,
                               const u32* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                               float background_r, float background_g, float background_b, float* image,
                               float* transmittance, float* depth, u16* masks)>
    kRasterCpuForward{"raster_cpu_forward"};
inline constexpr Declared<RasterPartsKernel> kRasterGpuParts{"raster_gpu_parts"};
inline constexpr Declared<RasterForwardKernel> kRasterGpuForward{"raster_gpu_forward"};
inline constexpr Declared<RasterJoinKernel> kRasterGpuJoin{"raster_gpu_join"};
inline constexpr Declared<void(
    const float* records, const u32* sorted_ids, const u32* sorted_slots, const u32* tile_ranges, int tiles_x,
    int tiles_y, int width, int height, const float* image, const float* v_image, const u16* masks,
    const float* more_colours, const float* v_more, int more_channels, Slots* slots)>
    kRasterCpuBackward{"raster_cpu_backward"};
inline constexpr Declared<void(
    const float* records, const u32* sorted_ids, const u32* sorted_slots, const u32* tile_ranges, int tiles_x,
    int tiles_y, int width, int height, const float* image, const float* v_image, const u16* masks,
    const float* states, const float* more_colours, const float* v_more, int more_channels, Slots* slots)>
    kRasterGpuBackward{"raster_gpu_backward"};
inline constexpr Declared<void(u32 count, const u32* tile_counts, const u32* slot_offsets, const Slots* slots,
                               const u16* masks, const float* records, float* v_records)>
    kSumSlotsVector{"sum_slots_vector"};
inline constexpr Declared<void(u32 count, const u32* tile_counts, const u32* slot_offsets, const Slots* slots,
                               const u16* masks, float* v_records)>
    kSumSlotsScalar{"sum_slots_scalar"};
inline constexpr Declared<MeasureWeightsKernel> kMeasureWeights{"measure_weights"};

// ---- Image loss ----
inline constexpr Declared<LossMarginsKernel> kLossMargins{"loss_margins"};
inline constexpr Declared<LossWindowKernel> kLossWindow{"loss_window"};
inline constexpr Declared<LossGradientKernel> kLossGradient{"loss_gradient"};
inline constexpr Declared<LossTotalKernel> kLossTotal{"loss_total"};

// ---- Prefix sums ----
template <typename In, typename Sum>
inline constexpr Declared<void(const In* in, u32 count, u32 block, Sum* sums)> kScanSums{"scan_sums"};
template <typename In, typename Sum>
inline constexpr Declared<void(const In* in, u32 count, u32 block, const Sum* sums, Sum* out)> kScanWrite{
    "scan_write"};

// ---- Tile lists by chunks ----
// ChunkSums contains, for one chunk, the number of visible splats, the number of their tiles, the smallest
// key and the largest key.
using ChunkSums = std::array<u64, 4>;
inline constexpr Declared<void(const u32* tile_counts, const u32* depth_keys, u32 count, u32 chunk, u32 bits,
                               ChunkSums* sums, u32* histogram)>
    kChunkSums{"count_sums"};
inline constexpr Declared<void(const u32* tile_counts, const u32* depth_keys, u32 count, u32 chunk, u32 bits,
                               const ChunkSums* sums, u32* histogram, const u32* starts, u32* slot_offsets,
                               u64* pairs, u64* totals)>
    kChunkWrite{"count_write"};
inline constexpr Declared<void(const u64* pairs, u32 most, const u32* counted, u32 chunk, u32 base, u32 shift,
                               u32 bits, u32* histogram)>
    kChunkHistogram{"radix_histogram"};
inline constexpr Declared<void(const u64* pairs, u32 most, const u32* counted, u32 chunk, u32 base, u32 shift,
                               u32 bits, u32* histogram, const u32* starts, u64* pairs_out, u32* ids_out)>
    kChunkScatter{"radix_scatter"};
inline constexpr Declared<void(u32* histogram, u32 chunks, u32 bins, u32 block, u32* totals)> kColumnScan{
    "column_scan"};
inline constexpr Declared<void(u32* histogram, u32 chunks, u32 bins, u32* starts)> kColumnStarts{
    "column_starts"};
inline constexpr Declared<void(const u32* order, const u32* tile_rects, u32 most, const u32* counted,
                               u32 chunk, u32 tiles_x, u32 tiles, u32* histogram)>
    kTileHistogram{"tile_histogram"};
inline constexpr Declared<void(const u32* order, const u32* tile_rects, const u32* slot_offsets, u32 most,
                               const u32* counted, u32 chunk, u32 tiles_x, u32 tiles, u32* histogram,
                               const u32* tile_ranges, u32* sorted_ids, u32* sorted_slots)>
    kTileScatter{"tile_scatter"};

// ---- Tile lists by groups ----
inline constexpr Declared<void(const u32* tile_counts, const u32* depth_keys, u32 count, u32* histogram,
                               u64* sums)>
    kCountSums{"count_sums"};
inline constexpr Declared<void(u32* histogram, u32 blocks, u32* digits, u64* sums)> kCountRows{"count_rows"};
inline constexpr Declared<void(u32* tile_counts, const u32* depth_keys, u32 count, const u32* offsets,
                               const u32* digits, const u64* sums, u64 drawn_room, u64 pairs_room, u32* keys,
                               u32* ids, u32* slot_offsets, u64* totals, u32* drawn, u32* pairs)>
    kCountWrite{"count_write"};
inline constexpr Declared<void(const u32* order, u32 most, const u32* counted, const u32* tile_rects,
                               u32 block, u32* firsts, u32* sums)>
    kAreaSums{"area_sums"};
template <typename Key>
inline constexpr Declared<void(const Key* keys, u32 most, const u32* counted, u32 shift, u32* histogram)>
    kRadixHistogram{"radix_histogram"};
inline constexpr Declared<void(u32* histogram, u32 blocks, u32* totals)> kRadixRows{"radix_rows"};
template <typename Key>
inline constexpr Declared<void(const Key* keys, const u32* values, const u32* values2, u32 most,
                               const u32* counted, u32 shift, const u32* offsets, const u32* totals,
                               Key* keys_out, u32* values_out, u32* values2_out)>
    kRadixScatter{"radix_scatter"};
template <typename Key>
inline constexpr Declared<void(const u32* order, const u32* firsts, const u32* sums, u32 block,
                               u32 most_drawn, const u32* drawn, u32 most_pairs, const u32* pairs,
                               const u32* tile_rects, const u32* slot_offsets, u32 tiles_x, Key* tiles,
                               u32* ids, u32* slots, u32* histogram, u32* long_lists)>
    kEmitIntersections{"emit_intersections"};
template <typename Key>
inline constexpr Declared<void(const Key* tiles_sorted, u32 most_pairs, const u32* pairs, u32 tiles,
                               u32* tile_ranges, u32* long_lists)>
    kFindRanges{"find_ranges"};

}  // namespace ubs::opencl
