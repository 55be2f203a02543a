// SPDX-License-Identifier: Apache-2.0
// The sheet of scaling plots: time above memory, one column for what grows.
#include <fmt/format.h>

#include <algorithm>

#include "host/base/memory_limit.hpp"
#include "host/bench/scaling.hpp"
#include "host/report/svg_chart.hpp"

namespace ubs::bench {
namespace {

constexpr int kPanelWidth = 420, kPanelHeight = 330;

struct Column {
  std::string title, x_label;
  std::vector<std::string> series;
};

ChartSeries measured(const std::vector<ScalingPoint>& points, const std::string& series, bool time,
                     TimeKind kind) {
  ChartSeries line{.markers = true};
  for (const ScalingPoint& p : points) {
    if (p.series != series || !(time_of(p, kind) > 0)) continue;
    line.x.push_back(p.x);
    line.y.push_back(time ? time_of(p, kind) : static_cast<double>(p.peak_bytes) / kMiB);
  }
  return line;
}

ChartSeries fitted(const ChartSeries& line, const PowerLaw& law, bool time) {
  ChartSeries curve{.colour = line.colour + 1, .dashed = true};
  const std::size_t from = std::min(line.x.size() / 2, line.x.size() - 2);
  for (std::size_t i = from; i < line.x.size(); ++i) {
    curve.x.push_back(line.x[i]);
    curve.y.push_back(time ? law(line.x[i]) : law(line.x[i]) / kMiB);
  }
  curve.name = fmt::format("upper half x^{:.2f}", law.exponent);
  return curve;
}

Html panel(const Column& column, const std::vector<ScalingPoint>& points, const std::vector<ScalingFit>& fits,
           bool time, TimeKind kind) {
  std::vector<ChartSeries> lines;
  for (const std::string& series : column.series) {
    ChartSeries line = measured(points, series, time, kind);
    line.name = series == "dim" ? "N = 3, 4, 6, 7" : series;
    const auto law = std::ranges::find(fits, series, &ScalingFit::series);
    const bool has_fit = law != fits.end() && line.x.size() >= 2;
    line.colour = lines.size();
    lines.push_back(line);
    if (has_fit) lines.push_back(fitted(line, time ? law->time_upper : law->memory_upper, time));
  }
  return svg_chart({.title = column.title,
                    .x_label = column.x_label,
                    .y_label = !time                    ? "peak device memory [MiB]"
                               : kind == TimeKind::wall ? "ms per training iteration"
                                                        : "processor ms a core, per iteration",
                    .log_x = true,
                    .log_y = true,
                    .legend = true,
                    .width = kPanelWidth,
                    .height = kPanelHeight},
                   lines);
}

}  // namespace

std::string scaling_plot(const std::vector<ScalingPoint>& points, const std::vector<ScalingFit>& fits,
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
  std::vector<Html> panels;
  for (const bool time : {true, false})
    for (Column column : columns) {
      if (time && panels.empty()) column.title += ", " + device.substr(0, 48);
      panels.push_back(panel(column, points, fits, time, kind));
    }
  return svg_sheet(panels, static_cast<int>(columns.size()), kPanelWidth, kPanelHeight);
}

}  // namespace ubs::bench
