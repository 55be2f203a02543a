// SPDX-License-Identifier: Apache-2.0
// This file declares the argument types of those kernels that all back ends share (kernels/map), and of those
// that have the same arguments in each back end. Because of these declarations, a launch with a wrong buffer
// or a wrong number of arguments does not compile. For kernels that all back ends launch in the same way
// (map_stages.hpp, map_metric_ops.hpp and parameter_stages.hpp), this file also contains the name.
#pragma once

#include <cstdint>
#include <type_traits>

#include "kernels/loss_weights.h"

namespace ubs {

using u8 = std::uint8_t;
using u16 = std::uint16_t;
using u32 = std::uint32_t;
using u64 = std::uint64_t;

// True if kernels take arguments of this type by value. These are numbers, and the structs that the host and
// the kernels share. This is a variable and not a concept, because CUDA sources are compiled as C++17.
template <typename T>
inline constexpr bool kKernelValue =
    std::is_arithmetic_v<T> || std::is_same_v<T, LossWeights> || std::is_same_v<T, PenaltyWeights>;

// Declared holds the name of a kernel whose arguments have the types of the function type `Signature`.
template <typename Signature>
struct Declared {
  const char* name;
};

using ProjectForwardKernel = void(const float* params, u32 count, u32 stride, u32 first_record,
                                  const float* cameras, u32 camera, float near_plane, float far_plane,
                                  float eps2d, float* records, u32* depth_keys, u32* tile_rects,
                                  u32* tile_counts);
using ProjectBackwardKernel = void(const float* params, u32 count, u32 stride, u32 first_record,
                                   const float* cameras, u32 camera, float near_plane, float far_plane,
                                   float eps2d, const float* v_records, float* v_params, u32 accumulate);
using CameraBackwardKernel = void(const float* params, u32 count, u32 stride, u32 first_record,
                                  const float* cameras, u32 camera, float near_plane, float far_plane,
                                  float eps2d, const float* v_records, float* v_camera, u32 lanes);
using AdamKernel = void(float* params, const float* v_params, float* moment1, float* moment2,
                        const float* learning_rates, u32 count, u32 stride, float beta1, float beta2,
                        float epsilon, float inverse_bias1, float inverse_sqrt_bias2);
inline constexpr Declared<AdamKernel> kAdam{"adam_step"};
using WatchedAdamKernel = void(float* params, const float* v_params, float* moment1, float* moment2,
                               const float* learning_rates, u32 count, u32 stride, float beta1, float beta2,
                               float epsilon, float inverse_bias1, float inverse_sqrt_bias2, u32* sentinel,
                               u32 stamp);
inline constexpr Declared<WatchedAdamKernel> kWatchedAdam{"adam_step_watched"};
using RegulariseKernel = void(const float* params, float* v_params, u32 count, u32 stride,
                              PenaltyWeights weights);
inline constexpr Declared<RegulariseKernel> kRegularise{"regularise"};
using AddNoiseKernel = void(float* params, u32 count, u32 stride, float amount, u32 seed0, u32 seed1,
                            u32 iteration0, u32 iteration1, u32 first_number);
inline constexpr Declared<AddNoiseKernel> kAddNoise{"add_noise"};
using McmcWeightsKernel = void(const float* params, u32 count, u32 stride, u32 alive_only, u32* weights,
                               u32* copies);
inline constexpr Declared<McmcWeightsKernel> kMcmcWeights{"mcmc_weights"};
using McmcDrawKernel = void(const u64* prefix, const u32* weights, u32 count, u32 slots, u32 purpose,
                            u32 seed0, u32 seed1, u32 iteration0, u32 iteration1, u32* sources, u32* copies,
                            u32* totals);
inline constexpr Declared<McmcDrawKernel> kMcmcDraw{"mcmc_draw"};
using McmcSourcesKernel = void(float* params, u32 count, u32 stride, const u32* copies, float spread,
                               float* moment1, float* moment2);
inline constexpr Declared<McmcSourcesKernel> kMcmcSources{"mcmc_sources"};
using McmcCopiesKernel = void(float* params, u32 stride, u32 first, u32 slots, const u32* sources,
                              float* moment1, float* moment2);
inline constexpr Declared<McmcCopiesKernel> kMcmcCopies{"mcmc_copies"};
using McmcPlacesKernel = void(float* params, u32 stride, u32 first, u32 slots, const u32* sources,
                              float spread, u32 purpose, u32 seed0, u32 seed1, u32 iteration0, u32 iteration1,
                              u32 first_number);
inline constexpr Declared<McmcPlacesKernel> kMcmcPlaces{"mcmc_places"};

using FitListsKernel = void(const u64* totals, u64 drawn_room, u64 pairs_room, u32 count, u32 items,
                            u32* tile_counts, u32* drawn, u32* pairs);

using RasterForwardKernel = void(const float* records, const u32* sorted_ids, const u32* sorted_slots,
                                 const u32* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                                 float background_r, float background_g, float background_b, float* image,
                                 float* transmittance, float* depth, u16* masks, float* states,
                                 const u32* long_lists, float* parts);
using RasterPartsKernel = void(const float* records, const u32* sorted_ids, const u32* tile_ranges,
                               int tiles_x, int tiles_y, int width, int height, const u32* long_lists,
                               float* parts);
using RasterJoinKernel = void(const u32* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                              float background_r, float background_g, float background_b, float* image,
                              float* transmittance, float* depth, float* states, const u32* long_lists,
                              const float* parts);
using MeasureWeightsKernel = void(const float* records, const u32* sorted_ids, const u32* sorted_slots,
                                  const u32* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                                  const u16* masks, float* weights);
using LossMarginsKernel = void(float* maps, int map_pitch, int map_plane, int pitch);
using LossWindowKernel = void(const float* image, const u8* target, const float* target_float, int width,
                              int height, int pitch, int rows, int first_channel, int channels, float low,
                              float high, float* maps, int map_pitch, int map_plane, float* tile_sums,
                              const u8* mask);
using LossGradientKernel = void(const float* image, const u8* target, const float* target_float, int width,
                                int height, int pitch, int rows, int first_channel, int channels,
                                LossWeights weights, const float* maps, int map_pitch, int map_plane,
                                float* v_image, const u8* mask);
using LossTotalKernel = void(const float* tile_sums, int tiles, float pixels, float* sums, u32 sums_offset);

using MapColoursKernel = void(const float* image, u32 plane, const float* numbers, u32 first, float* mapped);
inline constexpr Declared<MapColoursKernel> kMapColours{"map_colours"};
using MapColoursVjpKernel = void(const float* image, int width, int height, int pitch, int rows,
                                 const float* numbers, u32 first, float* v_image, float* sums);
inline constexpr Declared<MapColoursVjpKernel> kMapColoursVjp{"map_colours_vjp"};
using RowSumsKernel = void(float* sums, int pitch, int count);
inline constexpr Declared<RowSumsKernel> kRowSums{"row_sums"};
using AppearanceGradientKernel = void(const float* sums, int pitch, int strips, const float* numbers,
                                      u32 first, float* gradient, u32 first_gradient);
inline constexpr Declared<AppearanceGradientKernel> kAppearanceGradient{"appearance_gradient"};
using AppearanceStepKernel = void(float* state, u32 images, u32 image, const float* gradient,
                                  u32 first_gradient, float rate_diagonal, float rate_other, float beta1,
                                  float beta2, float epsilon, u32* sentinel, u32 stamp);
inline constexpr Declared<AppearanceStepKernel> kAppearanceStep{"appearance_step"};

using DrawSkyKernel = void(const float* cameras, u32 camera, const float* sky, int pitch, int rows,
                           const float* transmittance, float* image);
inline constexpr Declared<DrawSkyKernel> kDrawSky{"draw_sky"};
using SkyVjpKernel = void(const float* cameras, u32 camera, int width, int height, int pitch, int rows,
                          const float* transmittance, const float* v_image, float* sums);
inline constexpr Declared<SkyVjpKernel> kSkyVjp{"sky_vjp"};
using SkyGradientKernel = void(const float* sums, int pitch, int strips, float* gradient, u32 first);
inline constexpr Declared<SkyGradientKernel> kSkyGradient{"sky_gradient"};
using SkyStepKernel = void(float* state, const float* gradients, u32 views, float rate, float rate_harmonics,
                           float beta1, float beta2, float epsilon, float inverse_bias1,
                           float inverse_sqrt_bias2, u32* sentinel, u32 stamp);
inline constexpr Declared<SkyStepKernel> kSkyStep{"sky_step"};

using AlphaToColoursKernel = void(int width, int height, int pitch, int rows, const float* v_alpha,
                                  const float* transmittance, float* image, float* v_image);
inline constexpr Declared<AlphaToColoursKernel> kAlphaToColours{"alpha_to_colours"};
using DepthSumsKernel = void(int width, int height, int pitch, int rows, const float* depth,
                             const float* v_depth, float* sums);
inline constexpr Declared<DepthSumsKernel> kDepthSums{"depth_sums"};
using DepthMeanKernel = void(const float* sums, int pitch, int strips, float* mean);
inline constexpr Declared<DepthMeanKernel> kDepthMean{"depth_mean"};
using DepthToRecordsKernel = void(const float* mean, u32 count, float* records);
inline constexpr Declared<DepthToRecordsKernel> kDepthToRecords{"depth_to_records"};
using DepthToImageKernel = void(int width, int height, int pitch, int rows, const float* mean,
                                const float* depth, const float* v_depth, float* image, float* v_image);
inline constexpr Declared<DepthToImageKernel> kDepthToImage{"depth_to_image"};
using DepthFromRecordsKernel = void(u32 count, const float* earlier, float* v_records);
inline constexpr Declared<DepthFromRecordsKernel> kDepthFromRecords{"depth_from_records"};

using MarkDrawnKernel = void(const u32* tile_counts, u32 count, u32* marks);
inline constexpr Declared<MarkDrawnKernel> kMarkDrawn{"mark_drawn"};
using PickDrawnKernel = void(const float* records, const u32* tile_rects, const u32* places, u32 count,
                             float* drawn);
inline constexpr Declared<PickDrawnKernel> kPickDrawn{"pick_drawn"};
using UnpackDrawnKernel = void(float* records, u32 count, u32* depth_keys, u32* tile_rects, u32* tile_counts);
inline constexpr Declared<UnpackDrawnKernel> kUnpackDrawn{"unpack_drawn"};
using SpreadGradientKernel = void(const float* drawn, const u32* places, u32 count, float* v_records);
inline constexpr Declared<SpreadGradientKernel> kSpreadGradient{"spread_gradient"};

using LoadImageKernel = void(const u8* bytes, const float* values, int width, int height, int pitch, int rows,
                             float scale_r, float scale_g, float scale_b, float offset_r, float offset_g,
                             float offset_b, int plane, float* out);
inline constexpr Declared<LoadImageKernel> kLoadImage{"load_image"};
using Im2colKernel = void(const float* image, int width, int height, int plane, int window, int stride,
                          int padding, int out_width, int first, int count, int pitch, float* matrix);
inline constexpr Declared<Im2colKernel> kIm2col{"im2col"};
using BiasReluKernel = void(float* features, int first, const float* bias, int plane);
inline constexpr Declared<BiasReluKernel> kBiasRelu{"bias_relu"};
using MaxPoolKernel = void(const float* image, int width, int height, int plane, int window, int stride,
                           int out_width, int out_height, int out_plane, float* out);
inline constexpr Declared<MaxPoolKernel> kMaxPool{"max_pool"};
using LpipsDistanceKernel = void(const float* a, const float* b, const float* weights, int channels,
                                 int pixels, int plane, float* distances);
inline constexpr Declared<LpipsDistanceKernel> kLpipsDistance{"lpips_distance"};
using PartialSumsKernel = void(const float* values, int first, int count, int items, int sums_offset,
                               float* sums);
inline constexpr Declared<PartialSumsKernel> kSumInParts{"partial_sums"};
using SsimRowsKernel = void(const float* a, const float* b, int first, int width, int height, int pitch,
                            float* sums);
inline constexpr Declared<SsimRowsKernel> kSsimRows{"ssim_rows"};
using SsimColumnsKernel = void(float* sums, int width, int height, int pitch, int results);
inline constexpr Declared<SsimColumnsKernel> kSsimColumns{"ssim_columns"};

}  // namespace ubs
