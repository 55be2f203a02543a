// SPDX-License-Identifier: Apache-2.0
// Independent oracle: one view of a Beta splat model, its loss and the gradient of the loss, in double.
// Naive code written from the method alone; it includes plain data structures of the host and nothing of the
// kernels. Gradients come from a tape (tape.hpp) over the forward formulas, not from derived backward
// formulas. It has the documented clamps of the method (frustum limit, tanh floor, pivot floor, rim, largest
// alpha); study.hpp says where single precision must or may differ from it.
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
  bool query_grad = false;    // let the view direction carry a gradient to the position
  double alpha_min = 0;       // contributions of alpha <= alpha_min are left out
  ModelVariant variant = {};  // form of the method; the rows of the model follow from it
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
  std::vector<int>
      left_out;  // (H, W), splats that have a part there of alpha <= alpha_min, before or after the stop
  std::vector<double> closed;  // (H, W), transmittance at which the pixel was stopped; 0: it was not
  std::size_t visible = 0;     // splats that passed the culls
};
Render render(const Model& model, const Camera& camera, const Options& options);

struct Gradient {
  double loss = 0, l1 = 0, dssim = 0;
  std::vector<double> values;  // same layout as Model::values
};
// loss = weights.l1 * mean|I - target| + weights.dssim * (1 - SSIM(I, target)); target is (3, H, W).
Gradient gradient(const Model& model, const Camera& camera, std::span<const double> target,
                  const Options& options);
// Gradient of sum(weights * image); weights are (3, H, W).
std::vector<double> weighted_gradient(const Model& model, const Camera& camera,
                                      std::span<const double> weights, const Options& options);
// The same for numbers of colours (3, H, W) and depths (H, W; of pixels with alpha > 1e-6), of which one may
// be empty, and with respect to the camera: turn 3, shift 3 (a frame that turns by w about its centre, then
// shifts by u: R -> exp([w]) R, t -> exp([w]) t + u), fx, fy, cx, cy, time, extra 4. The footprints' part of
// it is of central differences of the whole formula.
struct ViewGradients {
  std::vector<double> values;
  std::array<double, 15> camera{};
};
ViewGradients view_gradients(const Model& model, const Camera& camera, std::span<const double> colour_weights,
                             std::span<const double> depth_weights, const Options& options);
double loss(const Model& model, const Camera& camera, std::span<const double> target, const Options& options);

// Mean of the zero-padded SSIM map (11 x 11 Gaussian, sigma 1.5) over all channels.
double ssim(std::span<const double> a, std::span<const double> b, int channels, int height, int width);
// The mean over the windows that lie inside of the image alone; at least one must.
double valid_ssim(std::span<const double> a, std::span<const double> b, int channels, int height, int width);
// d ssim / d a, for a loss on images alone.
std::vector<double> ssim_gradient(std::span<const double> a, std::span<const double> b, int channels,
                                  int height, int width);

}  // namespace ubs::oracle
