// SPDX-License-Identifier: Apache-2.0
// Line plots as images: linear or logarithmic axes, ticks with grid, markers, legend, title. For reports
// that people look at; several plots are put side by side with tile_images(). Text is ASCII.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

struct PlotSeries {
  std::string name;  // in the legend; "" keeps it out
  std::vector<double> x, y;
  bool line = true, markers = true, dashed = false;
  int colour = -1;                       // number in the palette; -1: by position
  std::vector<std::string> labels = {};  // beside the points; none, or one a point
};

struct PlotOptions {
  std::string title, x_label, y_label;
  bool log_x = false, log_y = false;
  bool from_zero = false;  // linear y axes start at 0
  int width = 720, height = 520;
};

// Points that are not finite, and on logarithmic axes those that are not positive, are left out; a plot
// without any point says so in its middle. Throws Error(internal) when x and y differ in length.
Image8 draw_plot(const PlotOptions& options, std::span<const PlotSeries> series);

// Row by row on white; all images of one size.
Image8 tile_images(std::span<const Image8> images, int columns);

// Positions of labelled grid lines for a range: 1, 2 or 5 times a power of ten, on logarithmic axes powers of
// ten (not all of them beyond nine decades), with 2 and 5 times them where fewer than three powers lie in the
// range, and where that is not enough either, those of linear axes.
std::vector<double> axis_ticks(double low, double high, bool logarithmic);
// "1", "20K", "3M", "0.05", "1e-4".
std::string tick_text(double value);

}  // namespace ubs
