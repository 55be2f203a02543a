// SPDX-License-Identifier: Apache-2.0
// The splats of one view as footprints in the order of compositing, and which of them a row or a pixel sees.
// Bounding boxes only leave out what is beyond the support with room to spare.
#pragma once

#include <vector>

#include "host/lab/oracle/splat_formula.hpp"

namespace ubs::oracle {

struct Frame {
  Frame(const Model& model, const Camera& camera, const Options& options);
  // Of every splat of a model, in its order.
  Frame(const std::vector<Footprint<double>>& all, const Options& options);

  std::vector<std::size_t> splats;              // model index of each visible splat, front to back
  std::vector<Footprint<double>> footprints;    // in the same order
  std::vector<Footprint<double>> culled;        // the others, in the order of the model
  std::vector<std::size_t> culled_splats;       // their indices
  std::vector<double> half_width, half_height;  // of `footprints`: extent of the support [px], with room

  // Positions in `splats` of those that may reach the row of pixel centres at y, in their order.
  std::vector<int> reaching_row(double y) const;
};

std::vector<double> splat_parameters(const Model& model, const Rows& rows, std::size_t splat);

// One footprint a splat of the model; those that are culled have `visible` false.
std::vector<Footprint<double>> project(const Model& model, const Camera& camera, const Options& options);

struct Composited {       // by one pixel
  std::vector<int> list;  // positions in Frame::splats
  int left_out = 0;       // as in Render
  double closed = 0;
};
// Out of `candidates`.
void composite(const Frame& frame, const std::vector<int>& candidates, double x, double y,
               const Options& options, Composited& pixel);

}  // namespace ubs::oracle
