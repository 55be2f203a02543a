// SPDX-License-Identifier: Apache-2.0
#include "host/bench/scaling.hpp"

#include <algorithm>
#include <new>

#include "host/base/error.hpp"
#include "host/device/registry.hpp"

namespace ubs::bench {
namespace {

ScalingPoint point(const std::string& series, std::size_t splats, int side, int dim = 6,
                   std::size_t views = 4, int batch = 1) {
  ScalingPoint p;
  p.series = series;
  p.splats = splats;
  p.width = p.height = side;
  p.dim = dim;
  p.views = views;
  p.batch = batch;
  p.x = series == "splats"   ? static_cast<double>(splats)
        : series == "pixels" ? static_cast<double>(side) * side
        : series == "views"  ? static_cast<double>(views)
        : series == "batch"  ? batch
                             : ParameterLayout(dim).count;
  return p;
}

void measure(Device& device, const ScalingOptions& options, ScalingPoint& p) {
  const BenchScene scene = synthetic_object(p.dim, p.splats, p.width, p.height, p.views);
  const IterationMeasurement m = measure_iterations(
      device, scene,
      {.raster = raster_kind(options.raster, device.info()), .batch = p.batch, .limits = options.limits});
  p.iteration_ms = m.time.wall_ms.median;
  p.device_ms = m.time.device_ms.value_or(0);
  if (device.info().type == DeviceType::cpu) p.cpu_ms = m.time.cpu_ms / device.info().compute_units;
  p.intersections = m.intersections;
  p.peak_bytes = m.peak_bytes;
  p.predicted_bytes = m.predicted_bytes;
}

double work(const ScalingPoint& p) {
  return static_cast<double>(p.splats) + static_cast<double>(p.intersections) +
         static_cast<double>(p.width) * p.height;
}

// Points as (x, ms, bytes).
struct Sample {
  double x, ms, bytes;
};

// Of two at least, by rising x.
ScalingFit fit(const std::string& series, const std::vector<Sample>& samples) {
  std::vector<double> x, ms, bytes;
  for (const Sample& s : samples) {
    x.push_back(s.x);
    ms.push_back(s.ms);
    bytes.push_back(s.bytes);
  }
  const std::size_t from = std::min(x.size() / 2, x.size() - 2);
  const auto upper = [&](const std::vector<double>& all) { return std::span(all).subspan(from); };
  return {series, fit_power_law(x, ms), fit_power_law(upper(x), upper(ms)), fit_power_law(x, bytes),
          fit_power_law(upper(x), upper(bytes))};
}

}  // namespace

double time_of(const ScalingPoint& p, TimeKind kind) {
  return kind == TimeKind::wall ? p.iteration_ms : p.cpu_ms;
}

std::vector<ScalingPoint> scaling_points(const ScalingOptions& options) {
  std::vector<ScalingPoint> points;
  const bool quick = options.quick;
  for (const std::size_t splats : {1'000, 3'000, 10'000, 30'000, 100'000, 300'000, 1'000'000, 3'000'000})
    if (splats <= (quick ? std::min<std::size_t>(options.max_splats, 3'000) : options.max_splats))
      points.push_back(point("splats", splats, quick ? 64 : 400));
  const std::size_t usual = std::min<std::size_t>(options.max_splats, quick ? 1'000 : 100'000);
  const std::size_t few = std::min<std::size_t>(options.max_splats, quick ? 1'000 : 30'000);
  const int side = quick ? 48 : 200, middle = quick ? 48 : 400;
  for (const int s : quick ? std::vector<int>{32, 64} : std::vector<int>{100, 200, 400, 800, 1400, 2000})
    if (s <= options.max_side) points.push_back(point("pixels", usual, s));
  for (const std::size_t views :
       quick ? std::vector<std::size_t>{2, 4} : std::vector<std::size_t>{4, 16, 64, 256})
    points.push_back(point("views", few, side, 6, views));
  for (const int batch : quick ? std::vector<int>{1, 2} : std::vector<int>{1, 2, 4, 8})
    points.push_back(point("batch", few, side, 6, 4, batch));
  for (const int dim : quick ? std::vector<int>{3, 6} : std::vector<int>{3, 4, 6, 7})
    points.push_back(point("dim", usual, middle, dim));
  return points;
}

std::vector<ScalingPoint> measure_scaling(Device& device, const ScalingOptions& options) {
  std::vector<ScalingPoint> points = scaling_points(options);
  for (ScalingPoint& p : points) {
    try {
      measure(device, options, p);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::memory) throw;
      p.note = error.what();
    } catch (const std::bad_alloc&) {  // of the host
      p.note = "out of memory";
    }
    if (options.on_point) options.on_point(p);
  }
  return points;
}

std::vector<ScalingFit> fit_scaling(const std::vector<ScalingPoint>& points, TimeKind kind) {
  std::vector<ScalingFit> fits;
  for (const char* series : {"splats", "pixels", "views", "batch", "dim", "work"}) {
    std::vector<Sample> samples;
    const bool is_work = std::string_view(series) == "work";
    for (const ScalingPoint& p : points)
      if (time_of(p, kind) > 0 &&
          (is_work ? p.series == "splats" || p.series == "pixels" : p.series == series))
        samples.push_back({is_work ? work(p) : p.x, time_of(p, kind), static_cast<double>(p.peak_bytes)});
    std::ranges::sort(samples, {}, &Sample::x);
    // Splats and pixels may have the same point, of which "work" needs one.
    samples.erase(std::ranges::unique(samples, {}, &Sample::x).begin(), samples.end());
    if (samples.size() >= 2) fits.push_back(fit(series, samples));
  }
  return fits;
}

std::string scaling_csv(const std::vector<ScalingPoint>& points) {
  std::string text =
      "series,x,splats,width,height,views,batch,dim,intersections,iteration_ms,cpu_ms,device_ms,peak_bytes,"
      "predicted_bytes\n";
  for (const ScalingPoint& p : points)
    text += fmt::format("{},{:.0f},{},{},{},{},{},{},{},{:.5g},{:.5g},{:.5g},{},{}\n", p.series, p.x,
                        p.splats, p.width, p.height, p.views, p.batch, p.dim, p.intersections, p.iteration_ms,
                        p.cpu_ms, p.device_ms, p.peak_bytes, p.predicted_bytes);
  return text;
}

std::string scaling_text(const std::vector<ScalingFit>& fits) {
  std::string text = fmt::format("{:<8} {:>14} {:>12} {:>16} {:>12}\n", "grows by", "time exponent",
                                 "upper half", "memory exponent", "upper half");
  for (const ScalingFit& f : fits)
    text += fmt::format("{:<8} {:>14.2f} {:>12.2f} {:>16.2f} {:>12.2f}\n", f.series, f.time.exponent,
                        f.time_upper.exponent, f.memory.exponent, f.memory_upper.exponent);
  return text + "work = splats + intersections + pixels; dim counts the parameters of a splat\n";
}

}  // namespace ubs::bench
