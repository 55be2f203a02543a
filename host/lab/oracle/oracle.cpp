// SPDX-License-Identifier: Apache-2.0
// This file implements compositing, loss and gradient of the oracle. The backward pass uses two tapes: one
// per pixel (image -> footprints), and one per splat (footprint -> raw parameters).
#include "host/lab/oracle/oracle.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "host/lab/oracle/oracle_stages.hpp"

namespace ubs::oracle {
namespace {

template <class S>
struct Pixel {
  std::array<S, 3> rgb{S(0), S(0), S(0)};
  S transmittance = S(1), weighted_depth = S(0), weight = S(0);
};

template <class S>
Pixel<S> blend(const std::vector<Footprint<S>>& footprints, double x, double y, const Options& options) {
  Pixel<S> pixel;
  for (const Footprint<S>& f : footprints) {
    const S alpha = splat_alpha<S>(f, kernel_radius<S>(f, x, y), options.variant.kernel);
    const S weight = alpha * pixel.transmittance;
    for (int c = 0; c < 3; ++c) pixel.rgb[c] += weight * f.rgb[c];
    pixel.weighted_depth += weight * f.depth;
    pixel.weight += weight;
    pixel.transmittance = pixel.transmittance * (1.0 - alpha);
  }
  for (int c = 0; c < 3; ++c) pixel.rgb[c] += pixel.transmittance * options.background[c];
  return pixel;
}

// Calls visit(pixel index, x, y, composited splats) for every pixel.
template <class Visit>
void for_pixels(const Frame& frame, const Camera& camera, const Options& options, const Visit& visit) {
  Composited pixel;
  for (int row = 0; row < camera.height; ++row) {
    const std::vector<int> candidates = frame.reaching_row(row + 0.5);
    for (int column = 0; column < camera.width; ++column) {
      composite(frame, candidates, column + 0.5, row + 0.5, options, pixel);
      visit(static_cast<std::size_t>(row) * camera.width + column, column + 0.5, row + 0.5, pixel);
    }
  }
}

}  // namespace

Render render_frame(const Frame& frame, const Camera& camera, const Options& options) {
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * camera.height;
  Render out;
  out.width = camera.width, out.height = camera.height;
  out.image.resize(3 * pixels), out.alpha.resize(pixels), out.depth.resize(pixels);
  out.contributors.resize(pixels), out.left_out.resize(pixels), out.closed.resize(pixels);
  out.visible = frame.splats.size();
  std::vector<Footprint<double>> footprints;
  for_pixels(frame, camera, options, [&](std::size_t i, double x, double y, const Composited& seen) {
    footprints.clear();
    for (int k : seen.list) footprints.push_back(frame.footprints[k]);
    const Pixel<double> pixel = blend(footprints, x, y, options);
    for (int c = 0; c < 3; ++c) out.image[c * pixels + i] = pixel.rgb[c];
    out.alpha[i] = 1 - pixel.transmittance;
    out.depth[i] = pixel.weighted_depth / std::max(pixel.weight, 1e-10);
    out.contributors[i] = static_cast<int>(footprints.size());
    out.left_out[i] = seen.left_out, out.closed[i] = seen.closed;
  });
  return out;
}

namespace {

double mean_absolute(std::span<const double> a, std::span<const double> b) {
  if (a.size() != b.size()) throw std::invalid_argument("oracle: target and image have different sizes");
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(a[i] - b[i]);
  return sum / static_cast<double>(a.size());
}

}  // namespace

double image_loss(std::span<const double> image, std::span<const double> target, int width, int height,
                  LossWeights weights) {
  return weights.l1 * mean_absolute(image, target) +
         weights.dssim * (1 - ssim(image, target, 3, height, width));
}

std::vector<double> image_gradient(std::span<const double> image, std::span<const double> target, int width,
                                   int height, LossWeights weights) {
  std::vector<double> g = ssim_gradient(image, target, 3, height, width);
  for (std::size_t i = 0; i < g.size(); ++i) {
    const double difference = image[i] - target[i];
    const double sign = difference > 0 ? 1 : difference < 0 ? -1 : 0;
    g[i] = weights.l1 * sign / static_cast<double>(g.size()) - weights.dssim * g[i];
  }
  return g;
}

namespace {

template <class S>
std::array<S*, kFootprintInputs> inputs_of(Footprint<S>& f) {
  return {&f.mean[0], &f.mean[1], &f.conic[0], &f.conic[1], &f.conic[2], &f.opacity,
          &f.beta,    &f.rgb[0],  &f.rgb[1],   &f.rgb[2],   &f.depth};
}

Footprint<Var> taped(Tape& tape, const Footprint<double>& f) {
  Footprint<Var> result;
  result.mean = {f.mean[0], f.mean[1]};
  result.conic = {f.conic[0], f.conic[1], f.conic[2]};
  result.opacity = f.opacity, result.beta = f.beta, result.depth = f.depth;
  result.rgb = {f.rgb[0], f.rgb[1], f.rgb[2]};
  for (Var* x : inputs_of(result)) *x = Var::input(tape, x->value());
  return result;
}

using PixelGradient = std::array<double, 4>;  // d loss / d (red, green, blue, depth)

// Adds the gradient of one pixel to the gradients `out` of the footprints `list`, which are composited in
// this pixel.
void add_pixel(const Frame& frame, const std::vector<int>& list, double x, double y, const PixelGradient& g,
               const Options& options, Tape& tape, std::vector<FootprintGradient>& out) {
  tape.clear();
  std::vector<Footprint<Var>> footprints;
  for (int k : list) footprints.push_back(taped(tape, frame.footprints[k]));
  const Pixel<Var> pixel = blend(footprints, x, y, options);
  for (int c = 0; c < 3; ++c) tape.seed(pixel.rgb[c].node(), g[c]);
  if (g[3] != 0 && pixel.weight.value() > 1e-6) {
    const Var depth = pixel.weighted_depth / pixel.weight;
    tape.seed(depth.node(), g[3]);
  }
  tape.reverse();
  for (std::size_t i = 0; i < list.size(); ++i) {
    const auto inputs = inputs_of(footprints[i]);
    for (int k = 0; k < kFootprintInputs; ++k) out[list[i]][k] += tape.adjoint(inputs[k]->node());
  }
}

}  // namespace

std::vector<FootprintGradient> footprint_gradients(const Frame& frame, const Camera& camera,
                                                   const Options& options, std::span<const double> v_image,
                                                   std::span<const double> v_depth) {
  std::vector<FootprintGradient> result(frame.splats.size(), FootprintGradient{});
  const std::size_t pixels = v_image.size() / 3;
  Tape tape;
  for_pixels(frame, camera, options, [&](std::size_t i, double x, double y, const Composited& seen) {
    PixelGradient g{};
    if (!v_image.empty()) g = {v_image[i], v_image[pixels + i], v_image[2 * pixels + i], 0};
    if (!v_depth.empty()) g[3] = v_depth[i];
    if (!seen.list.empty() && g != PixelGradient{})
      add_pixel(frame, seen.list, x, y, g, options, tape, result);
  });
  return result;
}

std::vector<double> parameter_gradient(const std::vector<double>& raw, const Rows& rows, const Camera& camera,
                                       const Options& options, const FootprintGradient& g, Tape& tape) {
  tape.clear();
  std::vector<Var> inputs;
  for (double x : raw) inputs.push_back(Var::input(tape, x));
  Footprint<Var> f = footprint<Var>(inputs, rows, camera, options);
  const auto outputs = inputs_of(f);
  for (int k = 0; k < kFootprintInputs; ++k) tape.seed(outputs[k]->node(), g[k]);
  tape.reverse();
  std::vector<double> result;
  for (const Var& x : inputs) result.push_back(tape.adjoint(x.node()));
  return result;
}

std::vector<double> parameter_gradients(const Frame& frame, const Model& model, const Camera& camera,
                                        const Options& options,
                                        std::span<const FootprintGradient> footprints) {
  std::vector<double> result(model.values.size(), 0.0);
  const Rows rows(model.dim, options.variant);
  Tape tape;
  for (std::size_t k = 0; k < frame.splats.size(); ++k) {
    if (footprints[k] == FootprintGradient{}) continue;
    const std::size_t i = frame.splats[k];
    const std::vector<double> g =
        parameter_gradient(splat_parameters(model, rows, i), rows, camera, options, footprints[k], tape);
    for (int r = 0; r < rows.count; ++r) result[r * model.count + i] = g[r];
  }
  return result;
}

double gradient_cancellation(const Frame& frame, const Model& model, const Camera& camera,
                             const Options& options, std::span<const double> weights) {
  constexpr std::array<std::pair<int, int>, 3> kParts{{{0, 2}, {2, 5}, {5, kFootprintInputs}}};
  const std::vector<FootprintGradient> footprints = footprint_gradients(frame, camera, options, weights);
  const Rows rows(model.dim, options.variant);
  const std::vector<ParameterGroup> groups = parameter_groups(ParameterLayout(model.dim, options.variant));
  std::vector<double> sizes(groups.size(), 0.0), wholes(groups.size(), 0.0);
  Tape tape;
  for (std::size_t k = 0; k < frame.splats.size(); ++k) {
    if (footprints[k] == FootprintGradient{}) continue;
    const std::vector<double> raw = splat_parameters(model, rows, frame.splats[k]);
    std::vector<double> size(rows.count, 0.0), whole(rows.count, 0.0);
    for (const auto& [first, last] : kParts) {
      FootprintGradient part{};
      std::copy(footprints[k].begin() + first, footprints[k].begin() + last, part.begin() + first);
      const std::vector<double> g = parameter_gradient(raw, rows, camera, options, part, tape);
      for (int r = 0; r < rows.count; ++r) size[r] += std::abs(g[r]), whole[r] += g[r];
    }
    for (std::size_t n = 0; n < groups.size(); ++n)
      for (int r = groups[n].first; r < groups[n].first + groups[n].count; ++r)
        sizes[n] += size[r] * size[r], wholes[n] += whole[r] * whole[r];
  }
  double worst = 1;
  for (std::size_t n = 0; n < groups.size(); ++n)
    if (wholes[n] > 0) worst = std::max(worst, std::sqrt(sizes[n] / wholes[n]));
  return worst;
}

Model to_model(const SplatModel& model) {
  return {model.dim, model.count, std::vector<double>(model.values.begin(), model.values.end())};
}

Render render(const Model& model, const Camera& camera, const Options& options) {
  return render_frame(Frame(model, camera, options), camera, options);
}

double loss(const Model& model, const Camera& camera, std::span<const double> target,
            const Options& options) {
  return image_loss(render(model, camera, options).image, target, camera.width, camera.height, options.loss);
}

Gradient gradient(const Model& model, const Camera& camera, std::span<const double> target,
                  const Options& options) {
  const Frame frame(model, camera, options);
  const Render image = render_frame(frame, camera, options);
  Gradient result;
  result.l1 = mean_absolute(image.image, target);
  result.dssim = 1 - ssim(image.image, target, 3, camera.height, camera.width);
  result.loss = image_loss(image.image, target, camera.width, camera.height, options.loss);
  const std::vector<double> v_image =
      image_gradient(image.image, target, camera.width, camera.height, options.loss);
  result.values = parameter_gradients(frame, model, camera, options,
                                      footprint_gradients(frame, camera, options, v_image));
  return result;
}

std::vector<double> weighted_gradient(const Model& model, const Camera& camera,
                                      std::span<const double> weights, const Options& options) {
  if (weights.size() != 3 * static_cast<std::size_t>(camera.width) * camera.height)
    throw std::invalid_argument("oracle: weights and image have different sizes");
  const Frame frame(model, camera, options);
  return parameter_gradients(frame, model, camera, options,
                             footprint_gradients(frame, camera, options, weights));
}

namespace {

// Returns the camera after adding h to the one with the index k of its 15 parameters (see ViewGradients).
Camera moved(const Camera& camera, int k, double h) {
  Camera out = camera;
  if (k < 3) {
    const int a = (k + 1) % 3, b = (k + 2) % 3;
    const double c = std::cos(h), s = std::sin(h);
    const auto turn = [&](double& x, double& y) {
      const double before = x;
      x = c * x - s * y;
      y = s * before + c * y;
    };
    for (int i = 0; i < 3; ++i) turn(out.rotation[3 * a + i], out.rotation[3 * b + i]);
    turn(out.translation[a], out.translation[b]);
  } else if (k < 6) {
    out.translation[k - 3] += h;
  } else if (k < 11) {
    double* const values[] = {&out.fx, &out.fy, &out.cx, &out.cy, &out.time};
    *values[k - 6] += h;
  } else if (static_cast<std::size_t>(k - 11) < out.extra.size()) {
    out.extra[k - 11] += h;
  }
  return out;
}

}  // namespace

ViewGradients view_gradients(const Model& model, const Camera& camera, std::span<const double> colour_weights,
                             std::span<const double> depth_weights, const Options& options) {
  const Frame frame(model, camera, options);
  const Rows rows(model.dim, options.variant);
  const std::vector<FootprintGradient> footprints =
      footprint_gradients(frame, camera, options, colour_weights, depth_weights);
  ViewGradients out{parameter_gradients(frame, model, camera, options, footprints), {}};
  for (std::size_t n = 0; n < frame.splats.size(); ++n) {
    const std::vector<double> raw = splat_parameters(model, rows, frame.splats[n]);
    for (int k = 0; k < 15; ++k) {
      const double h = k < 6 ? 1e-4 : k < 10 ? 1e-2 : 1e-4;
      const auto at = [&](double step) {
        double sum = 0;
        Footprint<double> f = footprint<double>(raw, rows, moved(camera, k, step), options);
        const auto values = inputs_of(f);
        for (int o = 0; o < kFootprintInputs; ++o) sum += footprints[n][o] * *values[o];
        return sum;
      };
      out.camera[k] += (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h);
    }
  }
  return out;
}

}  // namespace ubs::oracle
