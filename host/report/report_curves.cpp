// SPDX-License-Identifier: Apache-2.0
// Charts of the page of `ubs report`: training curves and histograms of parameters.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "host/report/histogram.hpp"
#include "host/report/report_sections.hpp"
#include "host/report/splat_values.hpp"
#include "host/report/svg_chart.hpp"

namespace ubs {
namespace {

constexpr std::size_t kBins = 48;
constexpr double kOutside = 0.005;  // share of the values beyond either end of a histogram's axis
constexpr std::size_t kSmoothing =
    80;  // rows of a log for one row that a running mean reaches to either side

using Column = std::function<std::optional<double>(const RunLogRow&)>;

struct Curve {
  const char *title, *unit;
  Column value;
  bool log_y, markers, smooth;
};

ChartSeries series_of(const ReportRuns& runs, std::size_t r, const Curve& curve, const Column& x) {
  ChartSeries s{runs[r].record.name, {}, {}, r, curve.markers};
  for (const RunLogRow& row : runs[r].record.log) {
    const auto at = x(row), value = curve.value(row);
    if (!at || !value) continue;
    s.x.push_back(*at);
    s.y.push_back(*value);
  }
  return s;
}

Html chart(const ReportRuns& runs, const Curve& curve, const Column& x, const char* x_label) {
  std::vector<ChartSeries> all;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    ChartSeries s = series_of(runs, r, curve, x);
    if (curve.smooth && s.y.size() > 20) {
      ChartSeries mean = s;
      mean.y = smoothed(s.y, 1 + s.y.size() / kSmoothing);
      s.faint = true;
      all.push_back(std::move(mean));
    }
    all.push_back(std::move(s));
  }
  return svg_chart({.title = curve.title,
                    .x_label = x_label,
                    .y_label = curve.unit,
                    .log_y = curve.log_y,
                    .x_from_zero = true},
                   all);
}

Html legend(const ReportRuns& runs) {
  if (runs.size() == 1) return {};
  Html out;
  for (std::size_t r = 0; r < runs.size(); ++r) out += run_label(runs, r) + raw(" ");
  return paragraph("legend", out);
}

bool any_row(const ReportRuns& runs, const Column& value) {
  return std::any_of(runs.begin(), runs.end(), [&](const ReportRun& run) {
    return std::any_of(run.record.log.begin(), run.record.log.end(),
                       [&](const RunLogRow& row) { return value(row).has_value(); });
  });
}

// The quantity of every run that has it, by name.
struct Shared {
  SplatQuantity first;  // without values
  std::vector<std::pair<std::size_t, std::vector<double>>> values;
};

std::vector<Shared> shared_quantities(const ReportRuns& runs) {
  std::vector<Shared> all;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    if (!runs[r].model) continue;
    for (SplatQuantity& q : splat_quantities(*runs[r].model)) {
      auto at = std::find_if(all.begin(), all.end(), [&](const Shared& s) { return s.first.name == q.name; });
      if (at == all.end()) {
        all.push_back({{q.name, q.unit, q.meaning, q.logarithmic, q.unit_interval, {}}, {}});
        at = all.end() - 1;
      }
      at->values.emplace_back(r, std::move(q.values));
    }
  }
  return all;
}

std::string histogram_note(const Histogram& h) {
  std::string note =
      fmt::format("{:.3g} \xe2\x80\xa6 {:.3g} \xe2\x80\xa6 {:.3g}", h.minimum, h.median, h.maximum);
  if (h.below + h.above > 0) note += fmt::format("; {} of {} beyond the axis", h.below + h.above, h.values);
  return note;
}

Html histogram_figure(const ReportRuns& runs, const Shared& shared) {
  std::vector<double> together;
  for (const auto& [run, values] : shared.values)
    together.insert(together.end(), values.begin(), values.end());
  const Bins bins = shared.first.unit_interval
                        ? make_bins(0.0, 1.0, kBins)
                        : make_bins(std::move(together), kBins, shared.first.logarithmic, kOutside);
  std::vector<ChartSeries> series;
  Html notes;
  for (const auto& [run, values] : shared.values) {
    const Histogram h = make_histogram(values, bins);
    ChartSeries s{runs[run].record.name, bins.edges, h.share, run};
    for (double& y : s.y) y *= 100;
    s.steps = true;
    series.push_back(std::move(s));
    notes +=
        tag("div", (runs.size() > 1 ? run_label(runs, run) + raw(" ") : Html{}) + text(histogram_note(h)));
  }
  const Html svg = svg_chart({.title = shared.first.name,
                              .x_label = shared.first.unit,
                              .y_label = "share [%]",
                              .log_x = shared.first.logarithmic,
                              .y_from_zero = true,
                              .height = 190},
                             series);
  return tag("figure", svg + tag("figcaption", tag("div", text(shared.first.meaning)) + notes)) + raw("\n");
}

}  // namespace

Section curves_section(const ReportRuns& runs) {
  const Column iteration = [](const RunLogRow& row) { return std::optional<double>(row.iteration); };
  const Column seconds = [](const RunLogRow& row) { return row.seconds; };
  const std::vector<Curve> curves{
      {"training loss", "loss", [](const RunLogRow& row) { return row.loss; }, true, false, true},
      {"PSNR of the test views", "dB", [](const RunLogRow& row) { return row.test_psnr; }, false, true,
       false},
      {"SSIM of the test views", "SSIM", [](const RunLogRow& row) { return row.test_ssim; }, false, true,
       false},
      {"splats", "number", [](const RunLogRow& row) { return row.splats; }, false, false, false}};
  if (!any_row(runs, iteration)) return {"curves", "Training curves", {}};
  Html grid;
  for (const auto& [x, label] :
       {std::pair{&iteration, "iteration"}, std::pair{&seconds, "seconds of training"}})
    for (const Curve& curve : curves)
      if (any_row(runs, curve.value)) grid += tag("figure", chart(runs, curve, *x, label)) + raw("\n");
  const bool tested = any_row(runs, curves[1].value);
  return {
      "curves", "Training curves",
      legend(runs) + tag("div", {{"class", tested ? "charts four" : "charts two"}}, grid) +
          paragraph("note",
                    text("Above against iterations, below against seconds. The loss is that of the views of "
                         "each step: pale as logged, bold as a running mean."))};
}

Section parameters_section(const ReportRuns& runs) {
  Html grid;
  for (const Shared& shared : shared_quantities(runs)) grid += histogram_figure(runs, shared);
  if (grid.empty()) return {"parameters", "Parameters", {}};
  return {"parameters", "Parameters",
          paragraph("note",
                    text("Activated values of all splats; below each chart lowest, median and highest.")) +
              legend(runs) + tag("div", {{"class", "charts four"}}, grid)};
}

}  // namespace ubs
