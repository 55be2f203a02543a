// SPDX-License-Identifier: Apache-2.0
// Compositing, loss and gradient of the oracle. Every pixel looks at every splat: no tiles, no bounding
// boxes. Backward in two tapes: one per pixel (image -> footprints), one per splat (footprint -> raw
// parameters).
#include "tests/reference/oracle.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "tests/reference/splat_formula.hpp"

namespace ubs::oracle {
namespace {

constexpr int kFootprintInputs = 10;  // mean 2, conic 3, opacity, beta, rgb 3

struct Frame {
  std::vector<std::size_t> splats;            // model index of each visible splat, front to back
  std::vector<Footprint<double>> footprints;  // in the same order
  std::vector<std::vector<int>> lists;        // per pixel: positions in `splats` of the composited ones
  std::vector<int> left_out;                  // per pixel, as in Render
  std::vector<double> closed;
};

std::vector<double> splat_parameters(const Model& model, const Rows& rows, std::size_t splat) {
  std::vector<double> raw(rows.count);
  for (int r = 0; r < rows.count; ++r) raw[r] = model.values[r * model.count + splat];
  return raw;
}

void check(const Model& model, const Camera& camera, const Options& options) {
  const Rows rows(model.dim, options.variant);
  if (model.values.size() != static_cast<std::size_t>(rows.count) * model.count)
    throw std::invalid_argument("oracle: the model does not have dim and count values");
  if (camera.width <= 0 || camera.height <= 0) throw std::invalid_argument("oracle: empty image");
}

// Front to back by the depth as a float, ties by index, so that equal keys agree with a float sort.
void project_all(const Model& model, const Camera& camera, const Options& options, Frame& frame) {
  const Rows rows(model.dim, options.variant);
  std::vector<std::pair<float, std::size_t>> order;
  std::vector<Footprint<double>> all(model.count);
  for (std::size_t i = 0; i < model.count; ++i) {
    const std::vector<double> raw = splat_parameters(model, rows, i);
    all[i] = footprint<double>(raw, rows, camera, options);
    if (all[i].visible) order.emplace_back(static_cast<float>(all[i].depth), i);
  }
  std::sort(order.begin(), order.end());
  for (const auto& [depth, i] : order) {
    frame.splats.push_back(i);
    frame.footprints.push_back(all[i]);
  }
}

// Adds a pixel to the frame.
void composite(Frame& frame, double x, double y, const Options& options) {
  std::vector<int> list;
  double transmittance = 1, closed = 0;
  int left_out = 0;
  for (std::size_t i = 0; i < frame.footprints.size(); ++i) {
    const Footprint<double>& f = frame.footprints[i];
    const double r = kernel_radius<double>(f, x, y);
    if (!reaches(f, r, options.variant.kernel)) continue;
    const double alpha = splat_alpha<double>(f, r, options.variant.kernel);
    left_out += alpha <= options.alpha_min;
    if (alpha <= options.alpha_min || closed > 0) continue;
    if (transmittance * (1 - alpha) <= kMinTransmittance) {
      closed = transmittance;
      continue;
    }
    transmittance *= 1 - alpha;
    list.push_back(static_cast<int>(i));
  }
  frame.lists.push_back(std::move(list));
  frame.left_out.push_back(left_out);
  frame.closed.push_back(closed);
}

template <class S>
struct Pixel {
  std::array<S, 3> rgb{S(0), S(0), S(0)};
  S transmittance = S(1), weighted_depth = S(0), weight = S(0);
};

template <class S>
Pixel<S> blend(const std::vector<Footprint<S>>& footprints, double x, double y,
               const Options& options) {
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

Frame make_frame(const Model& model, const Camera& camera, const Options& options) {
  check(model, camera, options);
  Frame frame;
  project_all(model, camera, options, frame);
  for (int row = 0; row < camera.height; ++row)
    for (int column = 0; column < camera.width; ++column)
      composite(frame, column + 0.5, row + 0.5, options);
  return frame;
}

Render render_frame(const Frame& frame, const Camera& camera, const Options& options) {
  const std::size_t pixels = frame.lists.size();
  Render out;
  out.width = camera.width, out.height = camera.height;
  out.image.resize(3 * pixels), out.alpha.resize(pixels), out.depth.resize(pixels);
  out.contributors.resize(pixels);
  out.left_out = frame.left_out, out.closed = frame.closed;
  out.visible = frame.splats.size();
  std::vector<Footprint<double>> footprints;
  for (std::size_t i = 0; i < pixels; ++i) {
    footprints.clear();
    for (int k : frame.lists[i]) footprints.push_back(frame.footprints[k]);
    const double x = static_cast<double>(i % camera.width) + 0.5;
    const double y = static_cast<double>(i / camera.width) + 0.5;
    const Pixel<double> pixel = blend(footprints, x, y, options);
    for (int c = 0; c < 3; ++c) out.image[c * pixels + i] = pixel.rgb[c];
    out.alpha[i] = 1 - pixel.transmittance;
    out.depth[i] = pixel.weighted_depth / std::max(pixel.weight, 1e-10);
    out.contributors[i] = static_cast<int>(footprints.size());
  }
  return out;
}

double mean_absolute(std::span<const double> a, std::span<const double> b) {
  if (a.size() != b.size()) throw std::invalid_argument("oracle: the target has another size");
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(a[i] - b[i]);
  return sum / static_cast<double>(a.size());
}

std::vector<double> image_gradient(const Render& image, std::span<const double> target, double lambda) {
  std::vector<double> g = ssim_gradient(image.image, target, 3, image.height, image.width);
  for (std::size_t i = 0; i < g.size(); ++i) {
    const double difference = image.image[i] - target[i];
    const double sign = difference > 0 ? 1 : difference < 0 ? -1 : 0;
    g[i] = (1 - lambda) * sign / static_cast<double>(g.size()) - lambda * g[i];
  }
  return g;
}

std::array<Var*, kFootprintInputs> inputs_of(Footprint<Var>& f) {
  return {&f.mean[0], &f.mean[1], &f.conic[0], &f.conic[1], &f.conic[2],
          &f.opacity, &f.beta,    &f.rgb[0],   &f.rgb[1],   &f.rgb[2]};
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

using FootprintGradient = std::array<double, kFootprintInputs>;

// Adds the gradient of one pixel (g = dLoss/dRGB) to the footprints it composites.
void add_pixel(const Frame& frame, const std::vector<int>& list, double x, double y,
               const std::array<double, 3>& g, const Options& options, Tape& tape,
               std::vector<FootprintGradient>& out) {
  tape.clear();
  std::vector<Footprint<Var>> footprints;
  for (int k : list) footprints.push_back(taped(tape, frame.footprints[k]));
  const Pixel<Var> pixel = blend(footprints, x, y, options);
  for (int c = 0; c < 3; ++c) tape.seed(pixel.rgb[c].node(), g[c]);
  tape.reverse();
  for (std::size_t i = 0; i < list.size(); ++i) {
    const auto inputs = inputs_of(footprints[i]);
    for (int k = 0; k < kFootprintInputs; ++k) out[list[i]][k] += tape.adjoint(inputs[k]->node());
  }
}

std::vector<FootprintGradient> footprint_gradients(const Frame& frame, const Camera& camera,
                                                   const Options& options, const std::vector<double>& g) {
  std::vector<FootprintGradient> result(frame.splats.size(), FootprintGradient{});
  const std::size_t pixels = frame.lists.size();
  Tape tape;
  for (std::size_t i = 0; i < pixels; ++i) {
    const double x = static_cast<double>(i % camera.width) + 0.5;
    const double y = static_cast<double>(i / camera.width) + 0.5;
    add_pixel(frame, frame.lists[i], x, y, {g[i], g[pixels + i], g[2 * pixels + i]}, options, tape, result);
  }
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

}  // namespace

Model to_model(const SplatModel& model) {
  return {model.dim, model.count, std::vector<double>(model.values.begin(), model.values.end())};
}

Render render(const Model& model, const Camera& camera, const Options& options) {
  return render_frame(make_frame(model, camera, options), camera, options);
}

double loss(const Model& model, const Camera& camera, std::span<const double> target,
            const Options& options) {
  const Render image = render(model, camera, options);
  return (1 - options.lambda_dssim) * mean_absolute(image.image, target) +
         options.lambda_dssim * (1 - ssim(image.image, target, 3, camera.height, camera.width));
}

Gradient gradient(const Model& model, const Camera& camera, std::span<const double> target,
                  const Options& options) {
  const Frame frame = make_frame(model, camera, options);
  const Render image = render_frame(frame, camera, options);
  Gradient result;
  result.l1 = mean_absolute(image.image, target);
  result.dssim = 1 - ssim(image.image, target, 3, camera.height, camera.width);
  result.loss = (1 - options.lambda_dssim) * result.l1 + options.lambda_dssim * result.dssim;
  result.values.assign(model.values.size(), 0.0);

  const std::vector<FootprintGradient> footprints =
      footprint_gradients(frame, camera, options, image_gradient(image, target, options.lambda_dssim));
  const Rows rows(model.dim, options.variant);
  Tape tape;
  for (std::size_t k = 0; k < frame.splats.size(); ++k) {
    const std::size_t i = frame.splats[k];
    const std::vector<double> g =
        parameter_gradient(splat_parameters(model, rows, i), rows, camera, options, footprints[k], tape);
    for (int r = 0; r < rows.count; ++r) result.values[r * model.count + i] = g[r];
  }
  return result;
}

}  // namespace ubs::oracle
