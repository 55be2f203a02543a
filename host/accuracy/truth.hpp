// SPDX-License-Identifier: Apache-2.0
// The float64 side: one view of a model, its loss and gradient by the oracle of host/oracle, which is
// written from the method alone and differentiates by a tape; end to end, and stage by stage on inputs that
// are exact float64 results rounded to float32.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "host/oracle/oracle_stages.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::accuracy {

// What is rendered and compared; float32 and float64 get the same numbers.
struct Problem {
  SplatModel model;  // with its form of the method
  Camera camera;
  std::vector<float> target;  // (3, height, width)
  std::array<float, 3> background{};
  double near_plane = 0.01, far_plane = 1e10, eps2d = 0.3, lambda_dssim = 0.2;
  bool query_grad = false;
  // By pixel: left out of images that are compared, and without a gradient. Empty: there are none.
  std::vector<std::uint8_t> undecided;
};

// Planar 8-bit image / 255.
std::vector<float> planar_target(const Image8& image);

// A projected splat in the order of kernels/layout.h, as floats.
using Record = std::array<float, 16>;

struct StageTruth {
  std::vector<oracle::Footprint<double>> footprints;  // of every splat
  std::vector<std::array<double, 3>> factors;         // L00, L01, L11 of the conic
  std::vector<Record> records;                        // rounded; not visible ones lie far away, opacity 0
  std::vector<double> image;                          // of the rounded records (3, height, width)
  std::vector<float> image_rounded;
  std::vector<double> v_image;  // of the rounded image
  double loss = 0;
  std::vector<float> v_image_rounded;
  std::vector<oracle::FootprintGradient>
      v_footprints;               // of every splat, of the rounded v_image; in the product's terms
  std::vector<Record> v_records;  // rounded
  std::vector<double> v_params;   // of the rounded v_records
};

struct Truth {
  std::vector<double> image;     // (3, height, width)
  std::vector<double> v_image;   // d loss / d image
  std::vector<double> gradient;  // layout of the model
  double loss = 0;
};

oracle::Options oracle_options(const Problem& problem);
Truth compute_truth(const Problem& problem);
StageTruth compute_stage_truth(const Problem& problem);

}  // namespace ubs::accuracy
