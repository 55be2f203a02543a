// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/opencl_tuning.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace ubs::opencl {

const std::vector<TunedConstant>& tuned_constants() {
  using enum RasterKind;
  static const std::vector<TunedConstant> all{
      // The values must be multiples of 16 (whole vectors), and at most 64.
      {"UBS_CHUNK", 64, {32, 48}, "opencl/raster_cpu.cl", cpu, {"raster_forward", "raster_backward"}},
      {"UBS_PREFETCH_DISTANCE", 12, {4, 8, 16, 24, 32}, "opencl/raster_cpu.cl", cpu, {"raster_backward"}},
      // The values must be primes or 1. If cores choose their work-groups (core_groups.hpp), the value is 1.
      {"UBS_SCATTER", 31, {1, 101, 211}, "opencl/raster_cpu.cl", cpu, {"raster_forward", "raster_backward"}},
      {"UBS_SUM_GROUP", 64, {16, 32, 128, 256}, "opencl/slot_sum.cl", cpu, {"sum_slots"}},
      // The values must be multiples of 16. The kernel needs local memory for 52 + 4 UBS_LOSS_STRIP rows. A
      // row
      // has 16 floats more than this value.
      {"UBS_LOSS_TILE", 112, {48, 64, 80, 96}, "gpu/loss.cl", cpu, {"image_loss"}},
      {"UBS_LOSS_STRIP", 4, {2, 8}, "gpu/loss.cl", cpu, {"image_loss"}},
      {"UBS_PREFETCH_AHEAD", 1, {2, 4, 8}, "map/project.cl", cpu, {"project_forward", "project_backward"}},
      // With the 100K splats of the tuner, smaller distances are equally fast, but with 3M splats they are
      // slower.
      {"UBS_LISTS_AHEAD", 96, {48, 64, 128}, "opencl/tile_list_chunks.cl", cpu, {"lists"}},
      {"UBS_LISTS_BATCH", 1024, {256, 512, 2048}, "opencl/tile_list_chunks.cl", cpu, {"lists"}},
      {"UBS_PLACES_BATCH", 512, {128, 256, 1024}, "opencl/tile_list_chunks.cl", cpu, {"lists"}},
      // A work-group must be at least as large as the largest wave of all GPUs. The registers limit the
      // number of waves that run at
      // the same time. With the smallest groups, the fewest registers remain unused.
      {"UBS_PROJECT_GROUP",
       64,
       {128, 256},
       "host/opencl/projection.cpp",
       gpu,
       {"project_forward", "project_backward"}},
      // The values must be multiples of 32 and at most 256, the number of work-items of a tile.
      {"UBS_BACKWARD_BATCH", 128, {32, 64, 256}, "gpu/raster_backward.cl", gpu, {"raster_backward"}},
      {"UBS_BACKWARD_TURN", 32, {16}, "gpu/raster_backward.cl", gpu, {"raster_backward"}},
      // This constant selects the mechanism with which work-items exchange values (exchange.hpp). It is 0 if
      // the
      // device has no such mechanism, or if the tuned value is 0. Otherwise the host chooses the mechanism.
      {"UBS_SUBGROUPS", 0, {0, 1}, "gpu/exchange.h", gpu, {"raster_backward"}},
      {"UBS_SUM_GROUP_GPU", 64, {32, 128, 256}, "gpu/sum_slots.cl", gpu, {"sum_slots"}},
      {"UBS_LOSS_TILE_GPU", 32, {16, 48, 64}, "gpu/loss.cl", gpu, {"image_loss"}},
      {"UBS_LOSS_GROUP", 128, {64, 256}, "gpu/loss.cl", gpu, {"image_loss"}},
  };
  return all;
}

unsigned tuned_value(const TuningValues& values, std::string_view macro) {
  return ubs::tuned_value(tuned_constants(), values, macro);
}

void add_tuning(const TuningValues& values, const std::vector<std::string>& sources,
                std::vector<std::string>& options) {
  for (const TunedConstant& constant : tuned_constants()) {
    const auto value = values.find(std::string(constant.macro));
    if (value == values.end() || std::ranges::count(sources, constant.source) == 0) continue;
    const std::string define = fmt::format("-D{}=", constant.macro);
    if (std::ranges::any_of(options, [&](const std::string& o) { return o.starts_with(define); })) continue;
    options.push_back(define + std::to_string(value->second));
  }
}

}  // namespace ubs::opencl
