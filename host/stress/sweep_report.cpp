// SPDX-License-Identifier: Apache-2.0
// Sweeps as CSV, as a table and as plots.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/report/plot.hpp"
#include "host/stress/sweep.hpp"

namespace ubs::stress {
namespace {

constexpr double kBound = 1e-3;
constexpr double kDrawnMost = 10, kDrawnLeast = 1e-9;  // errors beyond are drawn at the edge

std::string errors_csv(const SweepErrors& e) {
  return fmt::format("{:.3e},{:.3e},{},{:.3e},{:.3e},{}", e.value, e.gradient, e.group, e.worst_value,
                     e.worst_gradient, e.disagreed);
}

double worst_of(const SweepResult& result, const SweepErrors SweepPoint::*which, double SweepErrors::*error) {
  double worst = 0;
  for (const SweepPoint& p : result.points) worst = std::max(worst, p.*which.*error);
  return worst;
}

PlotSeries series_of(const SweepResult& result, const std::string& name, const SweepErrors SweepPoint::*which,
                     double SweepErrors::*error, int colour, bool dashed) {
  PlotSeries s{.name = name, .markers = !dashed, .dashed = dashed, .colour = colour};
  for (const SweepPoint& p : result.points) {
    s.x.push_back(p.x);
    s.y.push_back(std::clamp(p.*which.*error, kDrawnLeast, kDrawnMost));
  }
  return s;
}

}  // namespace

double reach_of(const SweepResult& result, const SweepErrors SweepPoint::*which, double bound) {
  double reach = 0;
  for (const SweepPoint& p : result.points) {
    if (!((p.*which).value <= bound && (p.*which).gradient <= bound)) break;
    reach = p.x;
  }
  return reach;
}

std::string sweep_csv(const std::vector<SweepResult>& results) {
  std::string text = "sweep,x,splats,culled";
  for (const char* name : {"safe", "naive", "half_ulp"})
    text += fmt::format(",{0}_value,{0}_gradient,{0}_group,{0}_worst_value,{0}_worst_gradient,{0}_disagreed",
                        name);
  text += '\n';
  for (const SweepResult& r : results)
    for (const SweepPoint& p : r.points)
      text += fmt::format("{},{:.6g},{},{},{},{},{}\n", r.name, p.x, p.splats, p.culled, errors_csv(p.safe),
                          r.has_naive ? errors_csv(p.naive) : ",,,,,", errors_csv(p.half_ulp));
  return text;
}

std::string sweep_text(const std::vector<SweepResult>& results) {
  std::string text = fmt::format(
      "{:<15} {:>21}  {:^31}  {:^31}  {:^21}\n{:<15} {:>21}  {:>9} {:>9} {:>11}  {:>9} {:>9} {:>11}  {:>10} "
      "{:>10}\n",
      "", "", "safe: worst", "naive: worst", "half an ulp", "sweep", "range", "value", "gradient",
      "<= 1e-3 to", "value", "gradient", "<= 1e-3 to", "value", "gradient");
  for (const SweepResult& r : results) {
    if (r.points.empty()) continue;
    text += fmt::format("{:<15} {:>10.3g}{:>11.3g}", r.name, r.points.front().x, r.points.back().x);
    for (const auto which : {&SweepPoint::safe, &SweepPoint::naive})
      if (which == &SweepPoint::naive && !r.has_naive)
        text += fmt::format("  {:>9} {:>9} {:>11}", "-", "-", "-");
      else
        text += fmt::format("  {:>9.1e} {:>9.1e} {:>11.3g}", worst_of(r, which, &SweepErrors::value),
                            worst_of(r, which, &SweepErrors::gradient), reach_of(r, which, kBound));
    text += fmt::format("  {:>10.1e} {:>10.1e}\n", worst_of(r, &SweepPoint::half_ulp, &SweepErrors::value),
                        worst_of(r, &SweepPoint::half_ulp, &SweepErrors::gradient));
  }
  return text;
}

Image8 sweep_plot(const std::vector<SweepResult>& results) {
  std::vector<Image8> panels;
  for (const SweepResult& r : results) {
    std::vector<PlotSeries> lines;
    if (r.has_naive)
      lines = {series_of(r, "naive, gradient", &SweepPoint::naive, &SweepErrors::gradient, 1, false),
               series_of(r, "naive, value", &SweepPoint::naive, &SweepErrors::value, 4, false)};
    for (const PlotSeries& line :
         {series_of(r, "safe, gradient", &SweepPoint::safe, &SweepErrors::gradient, 0, false),
          series_of(r, "safe, value", &SweepPoint::safe, &SweepErrors::value, 2, false),
          series_of(r, "half an ulp, gradient", &SweepPoint::half_ulp, &SweepErrors::gradient, 6, true)})
      lines.push_back(line);
    PlotSeries bound{.name = "1e-3", .markers = false, .dashed = true, .colour = 3};
    bound.x = {r.points.front().x, r.points.back().x};
    bound.y = {kBound, kBound};
    lines.push_back(bound);
    panels.push_back(draw_plot({.title = r.name + ": " + r.title,
                                .x_label = r.x_label,
                                .y_label = "relative error",
                                .log_x = true,
                                .log_y = true,
                                .width = 560,
                                .height = 420},
                               lines));
  }
  return tile_images(panels, 4);
}

}  // namespace ubs::stress
