// SPDX-License-Identifier: Apache-2.0
// Problem describes a view that is rendered and compared, and StageTruth contains the float64 result of each
// stage. The float64 reference computes these results: for the device check when ubs is built (vectors.hpp),
// and for host/lab/accuracy at run time.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "host/device/loss_weights.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/splat_model.hpp"
#include "kernels/layout.h"

namespace ubs::check {

// Problem is a view of a model with its target image. The float32 and the float64 code get exactly the same
// numbers.
struct Problem {
  SplatModel model;
  Camera camera;
  std::vector<float> target;  // (3, height, width)
  std::array<float, 3> background{};
  double near_plane = 0.01, far_plane = 1e10, eps2d = 0.3;
  LossWeights loss = loss_weights(0.2f);
  bool query_grad = false;
  // One value per pixel, or empty. The value is 1 for pixels that are not compared and have no gradient,
  // because the colours of these pixels depend on rounding. It is 0 for other pixels.
  std::vector<std::uint8_t> undecided;
};

// StageTruth contains the exact result of each stage. The inputs of a stage are the results of the previous
// stages, rounded to float32. Each array is therefore the expected result of one stage and, after rounding,
// the input of the next one.
struct StageTruth {
  std::vector<std::uint8_t> visible;  // one per splat
  // Projected splats in the layout of kernels/layout.h (count, kSplatStride). The records of invisible splats
  // have a large distance and the opacity 0.
  std::vector<double> records;
  std::vector<double> image;    // (3, height, width)
  std::vector<double> v_image;  // d loss / d image
  // d loss / d records, in the layout of kernels/layout.h (count, kGradStride)
  std::vector<double> v_records;
  std::vector<double> v_params;  // d loss / d parameters, in the layout of the model
  double loss = 0;
};

inline std::vector<float> rounded(const std::vector<double>& values) {
  std::vector<float> result(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) result[i] = static_cast<float>(values[i]);
  return result;
}

}  // namespace ubs::check
