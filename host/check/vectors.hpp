// SPDX-License-Identifier: Apache-2.0
// Vectors contains the inputs and the expected results of the device check. ubs_check_vectors
// (host/lab/accuracy/check_vectors.cpp) computes them when ubs is built, with the float64 reference of
// host/lab/oracle. They are embedded into the library, so a check needs no reference at run time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "host/check/stage_truth.hpp"

namespace ubs::check {

// Constants of the inputs, for ubs_check_vectors and for the check.
inline constexpr std::size_t kSplats = 160;
inline constexpr int kWidth = 31, kHeight = 27;
inline constexpr float kTarget = 0.5f;  // value of all pixels of the target image
inline constexpr std::uint64_t kDrawSeed = 123456789012345u, kDrawIteration = 900;
inline constexpr double kNoiseAmount = 0.5;
inline constexpr float kCopySpread = 0.5;
inline constexpr float kNoiseOpacity = -5;  // added to the raw opacities, so that noise affects all splats
inline constexpr float kOpacityWeight = 5, kScaleWeight = 7, kRate = 1e-3f;
inline constexpr std::uint64_t kAdamStep = 3;  // both bias corrections have an effect
inline constexpr int kMetricWidth = 37, kMetricHeight = 30;
inline constexpr unsigned kNetworkSeed = 7;
// Number of test cases for Adam. It is prime, so that each row of parameters uses different cases.
inline constexpr std::size_t kAdamCases = 503;

// FormVectors holds a small scene for one of the forms(), and its expected results.
struct FormVectors {
  Problem problem;
  StageTruth truth;
  // Gradient of the penalties with respect to the raw opacity and the three raw scales (4, count).
  std::vector<double> penalties;
  // Displacement of the positions by noise (3, count). It is a sum; displacement_size contains the magnitude
  // of its terms, which determines the rounding error (3, count).
  std::vector<double> displacement, displacement_size;
  // Raw parameters of a displaced copy of each splat (parameters, count), and the magnitude of the terms of
  // the displacement (3, count).
  std::vector<double> copies, copy_size;
};

struct LossValues {
  double l1 = 0, ssim = 0;
  std::array<double, 3> mse{};
};
// LossVectors holds an image with some values outside of [0, 1], its 8-bit target image, and the expected
// results.
struct LossVectors {
  int width = 0, height = 0;
  std::vector<double> image;         // (3, height, width)
  std::vector<std::uint8_t> target;  // (3, height, width)
  double lambda_dssim = 0;
  LossValues values, clamped;   // results for the image, and for the image clamped to [0, 1]
  std::vector<double> v_image;  // gradient of the loss of the image that is not clamped
};

// AdamVectors holds parameters with their moments and gradients, and the expected results of one Adam step
// and of the penalties.
struct AdamVectors {
  std::vector<double> parameter, moment1, moment2, gradient;  // values that float32 represents exactly
  std::vector<double> new_parameter, new_moment1, new_moment2;
  // Results of the same step with a gradient of 0: the change of the parameter, and the new moments.
  std::vector<double> step_at_rest, moment1_at_rest, moment2_at_rest;
  // Gradient of the penalties if `parameter` is the raw opacity, or a raw scale, of one of kSplats splats.
  std::vector<double> opacity_penalty, scale_penalty;
};

// MetricVectors holds the expected metrics of the two images, with the network, of metric_inputs.hpp.
struct MetricVectors {
  double lpips = 0, ssim = 0;
};

struct Vectors {
  std::vector<FormVectors> forms;  // in the order of forms()
  LossVectors loss;
  AdamVectors adam;
  MetricVectors metrics;
};

// Packs the vectors into bytes. Throws Error(internal) if an array does not have the size that its form
// requires.
std::vector<std::byte> pack(const Vectors& vectors);
// Unpacks vectors. Throws Error(internal) if the bytes are damaged, or were packed with another table of
// forms.
Vectors unpack(std::span<const std::byte> bytes);

// Returns the vectors of this build. The first call unpacks them.
const Vectors& embedded_vectors();

}  // namespace ubs::check
