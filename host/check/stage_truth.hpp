// SPDX-License-Identifier: Apache-2.0
// Problem and StageTruth describe a view that is rendered and compared, and the float64 result of each stage.
// The values come from the float64 reference: at build time for the device check (vectors.hpp), and at run
// time for host/lab/accuracy.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "host/device/loss_weights.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/splat_model.hpp"
#include "kernels/layout.h"

namespace ubs::check {

// Problem is a view of a model with its target image. float32 and float64 get the same numbers.
struct Problem {
  SplatModel model;  // with its variant
  Camera camera;
  std::vector<float> target;  // (3, height, width)
  std::array<float, 3> background{};
  double near_plane = 0.01, far_plane = 1e10, eps2d = 0.3;
  LossWeights loss = loss_weights(0.2f);
  bool query_grad = false;
  // For each pixel: 1 if it is not compared and has no gradient, because rounding decides its value. Empty:
  // no such pixels.
  std::vector<std::uint8_t> undecided;
};

// StageTruth contains the exact result of each stage. The inputs of a stage are the results of the previous
// stages, rounded to float32. Each array is therefore the expected result of one stage and, after rounding,
// the input of the next one.
struct StageTruth {
  std::vector<std::uint8_t> visible;  // one per splat
  // Projected splats in the layout of kernels/layout.h (count, kSplatStride). Invisible splats are far away
  // and have opacity 0.
  std::vector<double> records;
  std::vector<double> image;      // (3, height, width)
  std::vector<double> v_image;    // d loss / d image
  std::vector<double> v_records;  // in the layout of kernels/layout.h (count, kGradStride)
  std::vector<double> v_params;   // in the layout of the model
  double loss = 0;
};

inline std::vector<float> rounded(const std::vector<double>& values) {
  std::vector<float> result(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) result[i] = static_cast<float>(values[i]);
  return result;
}

}  // namespace ubs::check
