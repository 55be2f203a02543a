// SPDX-License-Identifier: Apache-2.0
// Vectors are the inputs and the expected results of a check of devices. ubs_check_vectors
// (host/lab/accuracy/check_vectors.cpp) makes them when ubs is built, with the float64 reference of
// host/lab/oracle, and they are embedded into the library. So a check needs no reference at run time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "host/check/stage_truth.hpp"

namespace ubs::check {

// What both sides, the build and the check, take as given.
inline constexpr std::size_t kSplats = 160;
inline constexpr int kWidth = 31, kHeight = 27;
inline constexpr float kTarget = 0.5f;  // of all pixels
inline constexpr std::uint64_t kDrawSeed = 123456789012345u, kDrawIteration = 900;
inline constexpr double kNoiseAmount = 0.5;
inline constexpr float kNoiseOpacity = -5;  // added to raw opacities, so that noise acts on all splats
inline constexpr float kOpacityWeight = 5, kScaleWeight = 7, kRate = 1e-3f;
inline constexpr std::uint64_t kAdamStep = 3;  // both bias corrections matter
inline constexpr int kMetricWidth = 37, kMetricHeight = 30;
inline constexpr unsigned kNetworkSeed = 7;
inline constexpr std::size_t kAdamCases = 503;  // no divisor of a count of splats

// A small scene in one of the forms().
struct FormVectors {
  Problem problem;
  StageTruth truth;
  // Gradient of the penalties with respect to raw opacity and the three raw scales (4, count).
  std::vector<double> penalties;
  // Displacement by noise, and the size of the terms that it is the sum of, which rounding goes by (3,
  // count).
  std::vector<double> displacement, displacement_size;
};

struct LossValues {
  double l1 = 0, ssim = 0;
  std::array<double, 3> mse{};
};
// An image that leaves [0, 1] in places, and its target in 8 bits.
struct LossVectors {
  int width = 0, height = 0;
  std::vector<double> image;         // (3, height, width)
  std::vector<std::uint8_t> target;  // (3, height, width)
  double lambda_dssim = 0;
  LossValues values, clamped;   // `clamped`: of the image clamped to [0, 1]
  std::vector<double> v_image;  // of `values`
};

// Values with their moments and a gradient, and what one step of Adam and the penalties make of them.
struct AdamVectors {
  std::vector<double> parameter, moment1, moment2, gradient;  // floats
  std::vector<double> new_parameter, new_moment1, new_moment2;
  // The same step with a gradient of 0: what is added to the parameter, and the moments.
  std::vector<double> step_at_rest, moment1_at_rest, moment2_at_rest;
  // Of `parameter` as a raw opacity and as a raw scale of one of kSplats splats.
  std::vector<double> opacity_penalty, scale_penalty;
};

// Of the two images and the network of metric_inputs.hpp.
struct MetricVectors {
  double lpips = 0, ssim = 0;
};

struct Vectors {
  std::vector<FormVectors> forms;  // in the order of forms()
  LossVectors loss;
  AdamVectors adam;
  MetricVectors metrics;
};

// Throws Error(internal) where an array has another size than the form requires.
std::vector<std::byte> pack(const Vectors& vectors);
// Throws Error(internal) where the bytes are damaged or made for another table of forms.
Vectors unpack(std::span<const std::byte> bytes);

// Returns the vectors of this build. The first call unpacks them.
const Vectors& embedded_vectors();

}  // namespace ubs::check
