// SPDX-License-Identifier: Apache-2.0
// Line charts as SVG, inline in pages: axes with labelled grid lines, lines, steps and markers.
// Colours are classes of the page's style (c0 ... c6 by `colour`), so that they follow its light and dark
// form. Without JavaScript; what a marker stands for is told by its title.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "host/report/html.hpp"

namespace ubs {

struct ChartSeries {
  std::string name;  // in titles of markers
  std::vector<double> x, y;
  std::size_t colour = 0;
  bool markers = false;  // a dot a point
  bool faint = false;    // thin and pale, behind the others
  bool steps = false;    // a histogram: y holds from x[i] to x[i + 1]; the last x ends it
  bool line = true, dashed = false;
  std::vector<std::string> labels = {};  // beside the points; none, or one a point
};

struct ChartOptions {
  std::string title, x_label, y_label;
  bool log_x = false, log_y = false;
  bool x_from_zero = false, y_from_zero = false;
  bool legend = false;  // the names that are not empty, in the corner where fewest points lie
  int width = 330, height = 230;
};

// Points that are not finite, and on logarithmic axes those that are not positive, are left out; lines of
// more points than pixels keep the lowest and the highest of each pixel. A chart without any point says so.
// Throws Error(internal) when x and y differ in length (steps: x has one more).
Html svg_chart(const ChartOptions& options, std::span<const ChartSeries> series);

// Positions of labelled grid lines for a range: 1, 2 or 5 times a power of ten, on logarithmic axes powers of
// ten (not all of them beyond nine decades), with 2 and 5 times them where fewer than three powers lie in the
// range, and where that is not enough either, those of linear axes.
std::vector<double> axis_ticks(double low, double high, bool logarithmic);
// "1", "20K", "3M", "0.05", "1e-4".
std::string tick_text(double value);

// Every value is the mean of the finite ones at most `reach` before and behind it, of as many on either side:
// the ends are not pulled to their neighbours.
std::vector<double> smoothed(std::span<const double> values, std::size_t reach);

}  // namespace ubs
