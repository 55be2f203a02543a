// SPDX-License-Identifier: Apache-2.0
// The oracle is an independent renderer: it computes one view of a Beta splat model, its loss and the
// gradient of the loss, in double precision. It is naive code that is written from the method alone. It
// includes plain data structures of the host, but nothing of the kernels. Gradients come from a tape
// (tape.hpp) over the forward formulas, not from derived backward formulas. It applies the documented clamps
// of the method (frustum limit, tanh floor, pivot floor, rim, largest alpha). study.hpp determines where
// single precision must agree with it and where it may differ.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "host/device/loss_weights.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::oracle {

struct Options {
  double near_plane = 0.01, far_plane = 1e10, eps2d = 0.3;
  std::array<double, 3> background{0, 0, 0};
  LossWeights loss = loss_weights(0.2f);
  bool query_grad = false;    // include the gradient of the position through the view direction
  double alpha_min = 0;       // contributions with alpha <= alpha_min are skipped
  ModelVariant variant = {};  // variant of the method; it determines the rows of the model
};

struct Model {
  int dim = 6;
  std::size_t count = 0;
  std::vector<double> values;  // raw parameters, rows in file order, `count` values per row
};
Model to_model(const SplatModel& model);

struct Render {
  int width = 0, height = 0;
  std::vector<double> image;      // (3, H, W), unclamped, background composited
  std::vector<double> alpha;      // (H, W), 1 - final transmittance
  std::vector<double> depth;      // (H, W), sum(w z) / max(sum w, 1e-10)
  std::vector<int> contributors;  // (H, W), composited splats (r < 1 and before the stop)
  // (H, W), number of splats with a contribution of alpha <= alpha_min, before or after the stop.
  std::vector<int> left_out;
  std::vector<double> closed;  // (H, W), transmittance at which the pixel was stopped; 0: not stopped
  std::size_t visible = 0;     // number of splats that are not culled
};
Render render(const Model& model, const Camera& camera, const Options& options);

struct Gradient {
  double loss = 0, l1 = 0, dssim = 0;
  std::vector<double> values;  // same layout as Model::values
};
// Returns the loss and its gradient. loss = weights.l1 * mean|I - target| +
// weights.dssim * (1 - SSIM(I, target)); target is (3, H, W).
Gradient gradient(const Model& model, const Camera& camera, std::span<const double> target,
                  const Options& options);
// Returns the gradient of sum(weights * image); weights are (3, H, W).
std::vector<double> weighted_gradient(const Model& model, const Camera& camera,
                                      std::span<const double> weights, const Options& options);
// Returns the gradients of a weighted sum of colours and depths with respect to the parameters and to the
// camera. The weights of the colours have the shape (3, H, W), and those of the depths (H, W). Only the
// depths of pixels with alpha > 1e-6 count. One of the weights may be empty. The gradient of the camera has
// 15 numbers: 3 for a rotation w, 3 for a shift u, then fx, fy, cx, cy, time, and 4 for the extra query
// values. The frame of the camera rotates by w about its centre and then shifts by u: R -> exp([w]) R, t ->
// exp([w]) t + u. The derivatives of the footprints with respect to the camera are central differences of the
// whole formula.
struct ViewGradients {
  std::vector<double> values;
  std::array<double, 15> camera{};
};
ViewGradients view_gradients(const Model& model, const Camera& camera, std::span<const double> colour_weights,
                             std::span<const double> depth_weights, const Options& options);
double loss(const Model& model, const Camera& camera, std::span<const double> target, const Options& options);

// Returns the mean of the zero-padded SSIM map (11 x 11 Gaussian, sigma 1.5) over all channels.
double ssim(std::span<const double> a, std::span<const double> b, int channels, int height, int width);
// Returns the mean over only those windows that are inside the image. There must be at least one.
double valid_ssim(std::span<const double> a, std::span<const double> b, int channels, int height, int width);
// Returns d ssim / d a, for a loss that depends only on images.
std::vector<double> ssim_gradient(std::span<const double> a, std::span<const double> b, int channels,
                                  int height, int width);

}  // namespace ubs::oracle
