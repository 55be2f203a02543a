// SPDX-License-Identifier: Apache-2.0
// How time and memory of a training iteration grow with splats, pixels, views, views a step, and N: on the
// synthetic object, whose blended splats a pixel stay the same throughout.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/bench/training_bench.hpp"
#include "host/report/log_log_fit.hpp"

namespace ubs::bench {

struct ScalingPoint {
  std::string series;  // splats, pixels, views, batch, dim
  double x = 0;        // what the series varies; for dim the parameters of a splat
  std::size_t splats = 0, views = 4;
  int width = 0, height = 0, batch = 1, dim = 6;
  // Results
  double iteration_ms = 0, device_ms = 0;
  double cpu_ms = 0;  // processor time a core, CPU devices only
  std::uint64_t intersections = 0, peak_bytes = 0, predicted_bytes = 0;
  std::string note;  // why there are none
};

struct ScalingOptions {
  std::string raster = "auto";
  std::size_t max_splats = 3'000'000;
  int max_side = 2000;
  bool quick = false;  // tiny points only
  SamplingLimits limits{.uncertainty = 0.02, .min_seconds = 0.3, .max_seconds = 4, .min_samples = 3};
  std::function<void(const ScalingPoint&)> on_point;
};

std::vector<ScalingPoint> scaling_points(const ScalingOptions& options);  // without results
// Points that do not fit into memory keep a note and no results.
std::vector<ScalingPoint> measure_scaling(Device& device, const ScalingOptions& options);

// What is fitted and drawn. Processor time is for CPU devices that others use at the same time.
enum class TimeKind { wall, processor };

double time_of(const ScalingPoint& point, TimeKind kind);  // 0: not measured

struct ScalingFit {
  std::string series;
  PowerLaw time, time_upper, memory,
      memory_upper;  // all points; the upper half, where constants no longer hide growth
};
// Of each series with at least two different x; "work" fits time against splats + intersections + pixels over
// the series of splats and pixels.
std::vector<ScalingFit> fit_scaling(const std::vector<ScalingPoint>& points, TimeKind kind = TimeKind::wall);

std::string scaling_csv(const std::vector<ScalingPoint>& points);
std::string scaling_text(const std::vector<ScalingFit>& fits);
// SVG
std::string scaling_plot(const std::vector<ScalingPoint>& points, const std::vector<ScalingFit>& fits,
                         const std::string& device, TimeKind kind = TimeKind::wall);

}  // namespace ubs::bench
