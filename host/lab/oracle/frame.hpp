// SPDX-License-Identifier: Apache-2.0
// Frame holds the splats of one view as footprints, in the order of compositing, and determines which of them
// may affect a row or a pixel. The bounding boxes of the splats have a margin, so that rounding cannot
// exclude a point of the support.
#pragma once

#include <vector>

#include "host/lab/oracle/splat_formula.hpp"

namespace ubs::oracle {

struct Frame {
  Frame(const Model& model, const Camera& camera, const Options& options);
  // `all` contains the footprint of every splat of a model, in the order of the model.
  Frame(const std::vector<Footprint<double>>& all, const Options& options);

  std::vector<std::size_t> splats;              // model index of each visible splat, front to back
  std::vector<Footprint<double>> footprints;    // in the same order
  std::vector<Footprint<double>> culled;        // the culled splats, in the order of the model
  std::vector<std::size_t> culled_splats;       // model index of each culled splat
  std::vector<double> half_width, half_height;  // extent of the support of `footprints` [px], with a margin

  // Returns the positions in `splats` of the splats that may reach the row of pixel centres at y, in the same
  // order.
  std::vector<int> reaching_row(double y) const;
};

// Returns the raw parameters of one splat, in the order of the rows.
std::vector<double> splat_parameters(const Model& model, const Rows& rows, std::size_t splat);

// Returns one footprint per splat of the model. Footprints of culled splats have `visible` false.
std::vector<Footprint<double>> project(const Model& model, const Camera& camera, const Options& options);

struct Composited {       // the splats that are composited at one pixel
  std::vector<int> list;  // positions in Frame::splats
  int left_out = 0;       // number of splats that are skipped because of Options::alpha_min
  double closed = 0;      // transmittance at which compositing stopped, or 0 if it did not stop
};
// Determines the splats among `candidates` that are composited at the pixel with the centre (x, y).
void composite(const Frame& frame, const std::vector<int>& candidates, double x, double y,
               const Options& options, Composited& pixel);

}  // namespace ubs::oracle
