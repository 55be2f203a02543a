// SPDX-License-Identifier: Apache-2.0
// The oracle is an independent renderer: it computes one view of a Beta splat model, its loss and the
// gradient of the loss, in double precision. It implements docs/method.md with simple code. It uses plain
// data structures of the host library, but no code of the kernels. The gradients come from automatic
// differentiation of the forward formulas (tape.hpp), not from derived backward formulas. The oracle applies
// the documented clamps of the method (frustum limit, tanh floor, pivot floor, rim, largest alpha). study()
// (study.hpp) determines in which pixels a single-precision program must agree with the oracle and in which
// it may differ.
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

// Render is the result of rendering one view. Compositing of a pixel stops at the splat that would reduce its
// transmittance to 1e-4 or less; this splat is not composited.
struct Render {
  int width = 0, height = 0;
  std::vector<double> image;      // (3, H, W), unclamped, background composited
  std::vector<double> alpha;      // (H, W), 1 - final transmittance
  std::vector<double> depth;      // (H, W), sum(w z) / max(sum w, 1e-10)
  std::vector<int> contributors;  // (H, W), number of composited splats
  // (H, W), number of splats that are skipped because alpha <= alpha_min. Splats after the stop are counted
  // only if alpha_min > 0.
  std::vector<int> left_out;
  std::vector<double> closed;  // (H, W), transmittance at the stop; 0: compositing did not stop
  std::size_t visible = 0;     // number of splats that are not culled
};
Render render(const Model& model, const Camera& camera, const Options& options);

struct Gradient {
  double loss = 0, l1 = 0, dssim = 0;
  std::vector<double> values;  // same layout as Model::values
};
// Returns the loss and its gradient. With the weights `l1` and `dssim` of options.loss, the loss is l1 *
// mean|I - target| + dssim * (1 - SSIM(I, target)). `target` has the shape (3, H, W).
Gradient gradient(const Model& model, const Camera& camera, std::span<const double> target,
                  const Options& options);
// Returns the gradient of sum(weights * image); weights are (3, H, W).
std::vector<double> weighted_gradient(const Model& model, const Camera& camera,
                                      std::span<const double> weights, const Options& options);
// ViewGradients contains the gradients with respect to the parameters of the model, in the layout of
// Model::values, and with respect to 15 parameters of the camera: 3 for a rotation w, 3 for a shift u, then
// fx, fy, cx, cy, time, and 4 for the extra query values. w rotates the frame of the camera about its centre,
// and then u shifts it: R -> exp([w]) R, t -> exp([w]) t + u.
struct ViewGradients {
  std::vector<double> values;
  std::array<double, 15> camera{};
};
// Returns the gradients of a weighted sum of colours and depths. The weights of the colours have the shape
// (3, H, W), and those of the depths (H, W). Depths are used only in pixels with alpha > 1e-6. One of the two
// spans of weights may be empty. The derivatives of the footprints with respect to the camera are central
// differences of the forward formula.
ViewGradients view_gradients(const Model& model, const Camera& camera, std::span<const double> colour_weights,
                             std::span<const double> depth_weights, const Options& options);
// Returns the same loss as gradient().
double loss(const Model& model, const Camera& camera, std::span<const double> target, const Options& options);

// Returns the mean of the zero-padded SSIM map (11 x 11 Gaussian, sigma 1.5) over all channels.
double ssim(std::span<const double> a, std::span<const double> b, int channels, int height, int width);
// Returns the mean of the SSIM map over only those windows that are completely inside the image. The image
// must have at least 11 x 11 pixels.
double valid_ssim(std::span<const double> a, std::span<const double> b, int channels, int height, int width);
// Returns the derivative of ssim() with respect to each value of `a`.
std::vector<double> ssim_gradient(std::span<const double> a, std::span<const double> b, int channels,
                                  int height, int width);

}  // namespace ubs::oracle
