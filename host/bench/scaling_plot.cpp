// SPDX-License-Identifier: Apache-2.0
// The sheet of scaling plots: time above memory, one column for what grows.
#include <fmt/format.h>

#include <algorithm>

#include "host/base/memory_limit.hpp"
#include "host/bench/scaling.hpp"
#include "host/report/plot.hpp"

namespace ubs::bench {
namespace {

struct Column {
  std::string title, x_label;
  std::vector<std::string> series;
};

PlotSeries measured(const std::vector<ScalingPoint>& points, const std::string& series, bool time,
                    TimeKind kind) {
  PlotSeries line;
  for (const ScalingPoint& p : points) {
    if (p.series != series || !(time_of(p, kind) > 0)) continue;
    line.x.push_back(p.x);
    line.y.push_back(time ? time_of(p, kind) : static_cast<double>(p.peak_bytes) / kMiB);
  }
  return line;
}

PlotSeries fitted(const PlotSeries& line, const PowerLaw& law, bool time) {
  PlotSeries curve{.markers = false, .dashed = true, .colour = line.colour + 1};
  const std::size_t from = std::min(line.x.size() / 2, line.x.size() - 2);
  for (std::size_t i = from; i < line.x.size(); ++i) {
    curve.x.push_back(line.x[i]);
    curve.y.push_back(time ? law(line.x[i]) : law(line.x[i]) / kMiB);
  }
  curve.name = fmt::format("upper half x^{:.2f}", law.exponent);
  return curve;
}

Image8 panel(const Column& column, const std::vector<ScalingPoint>& points,
             const std::vector<ScalingFit>& fits, bool time, TimeKind kind) {
  std::vector<PlotSeries> lines;
  for (const std::string& series : column.series) {
    PlotSeries line = measured(points, series, time, kind);
    line.name = series == "dim" ? "N = 3, 4, 6, 7" : series;
    const auto law = std::ranges::find(fits, series, &ScalingFit::series);
    const bool has_fit = law != fits.end() && line.x.size() >= 2;
    line.colour = static_cast<int>(lines.size());
    lines.push_back(line);
    if (has_fit) lines.push_back(fitted(line, time ? law->time_upper : law->memory_upper, time));
  }
  return draw_plot({.title = column.title,
                    .x_label = column.x_label,
                    .y_label = !time                    ? "peak device memory [MiB]"
                               : kind == TimeKind::wall ? "ms per training iteration"
                                                        : "processor ms a core, per iteration",
                    .log_x = true,
                    .log_y = true,
                    .width = 520,
                    .height = 400},
                   lines);
}

}  // namespace

Image8 scaling_plot(const std::vector<ScalingPoint>& points, const std::vector<ScalingFit>& fits,
                    const std::string& device, TimeKind kind) {
  const auto first = [&](const std::string& series) {
    const auto found = std::ranges::find(points, series, &ScalingPoint::series);
    return found == points.end() ? ScalingPoint{} : *found;
  };
  const ScalingPoint s = first("splats"), p = first("pixels"), v = first("views"), d = first("dim");
  const std::vector<Column> columns{
      {fmt::format("{}x{}, N = 6", s.width, s.height), "splats", {"splats"}},
      {fmt::format("{} splats, N = 6", p.splats), "pixels", {"pixels"}},
      {fmt::format("{} splats, {}x{}, N = 6", v.splats, v.width, v.height),
       "training views | views a step",
       {"views", "batch"}},
      {fmt::format("{} splats, {}x{}", d.splats, d.width, d.height), "parameters of a splat", {"dim"}}};
  std::vector<Image8> panels;
  for (const bool time : {true, false})
    for (Column column : columns) {
      if (time && panels.empty()) column.title += ", " + device.substr(0, 48);
      panels.push_back(panel(column, points, fits, time, kind));
    }
  return tile_images(panels, static_cast<int>(columns.size()));
}

}  // namespace ubs::bench
