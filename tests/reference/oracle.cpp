// SPDX-License-Identifier: Apache-2.0
// Compositing, loss and gradient of the oracle. Every pixel looks at every splat of which an exact bound does not
// say that it ends above or below the pixel's row: no tiles, no bounding boxes. Backward in two tapes: one per pixel (image -> footprints), one per splat (footprint -> raw
// parameters).
#include "tests/reference/oracle.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "tests/reference/oracle_stages.hpp"

namespace ubs::oracle {

std::vector<double> splat_parameters(const Model& model, const Rows& rows, std::size_t splat) {
  std::vector<double> raw(rows.count);
  for (int r = 0; r < rows.count; ++r) raw[r] = model.values[r * model.count + splat];
  return raw;
}

namespace {

void check(const Model& model, const Camera& camera, const Options& options) {
  const Rows rows(model.dim, options.variant);
  if (model.values.size() != static_cast<std::size_t>(rows.count) * model.count)
    throw std::invalid_argument("oracle: the model does not have dim and count values");
  if (camera.width <= 0 || camera.height <= 0) throw std::invalid_argument("oracle: empty image");
}

// No pixel of the row `y` lies inside: over all dx, r is at least dy^2 (Q11 - Q01^2 / Q00). What rounding may take
// from the difference of needles is granted to the splat.
bool misses_row(const Footprint<double>& f, double y, SpatialKernel kernel) {
  const double dy = f.mean[1] - y;
  const double slope = f.conic[2] - f.conic[1] * f.conic[1] / f.conic[0] - 1e-12 * f.conic[2];
  return slope > 0 && dy * dy * slope > (kernel == SpatialKernel::gaussian ? 9 : 1);
}

// Adds a pixel to the frame. `row`: positions of the footprints that may reach the pixel's row.
void composite(Frame& frame, const std::vector<int>& row, double x, double y, const Options& options) {
  std::vector<int> list;
  double transmittance = 1, closed = 0;
  int left_out = 0;
  for (const int i : row) {
    const Footprint<double>& f = frame.footprints[static_cast<std::size_t>(i)];
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
    list.push_back(i);
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

}  // namespace

std::vector<Footprint<double>> project(const Model& model, const Camera& camera, const Options& options) {
  check(model, camera, options);
  const Rows rows(model.dim, options.variant);
  std::vector<Footprint<double>> all(model.count);
  for (std::size_t i = 0; i < model.count; ++i) {
    const std::vector<double> raw = splat_parameters(model, rows, i);
    all[i] = footprint<double>(raw, rows, camera, options);
  }
  return all;
}

Frame make_frame(const std::vector<Footprint<double>>& footprints, const Camera& camera, const Options& options) {
  Frame frame;
  std::vector<std::pair<float, std::size_t>> order;
  for (std::size_t i = 0; i < footprints.size(); ++i)
    if (footprints[i].visible) order.emplace_back(static_cast<float>(footprints[i].depth), i);
  std::sort(order.begin(), order.end());
  for (const auto& [depth, i] : order) {
    frame.splats.push_back(i);
    frame.footprints.push_back(footprints[i]);
  }
  const SpatialKernel kernel = options.variant.kernel;
  std::vector<int> candidates;
  for (int row = 0; row < camera.height; ++row) {
    candidates.clear();
    for (std::size_t i = 0; i < frame.footprints.size(); ++i)
      if (!misses_row(frame.footprints[i], row + 0.5, kernel)) candidates.push_back(static_cast<int>(i));
    for (int column = 0; column < camera.width; ++column)
      composite(frame, candidates, column + 0.5, row + 0.5, options);
  }
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

namespace {

double mean_absolute(std::span<const double> a, std::span<const double> b) {
  if (a.size() != b.size()) throw std::invalid_argument("oracle: the target has another size");
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(a[i] - b[i]);
  return sum / static_cast<double>(a.size());
}

}  // namespace

std::vector<double> image_gradient(std::span<const double> image, std::span<const double> target, int width,
                                   int height, double lambda_dssim) {
  std::vector<double> g = ssim_gradient(image, target, 3, height, width);
  for (std::size_t i = 0; i < g.size(); ++i) {
    const double difference = image[i] - target[i];
    const double sign = difference > 0 ? 1 : difference < 0 ? -1 : 0;
    g[i] = (1 - lambda_dssim) * sign / static_cast<double>(g.size()) - lambda_dssim * g[i];
  }
  return g;
}

namespace {

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

}  // namespace

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

Model to_model(const SplatModel& model) {
  return {model.dim, model.count, std::vector<double>(model.values.begin(), model.values.end())};
}

Render render(const Model& model, const Camera& camera, const Options& options) {
  return render_frame(make_frame(project(model, camera, options), camera, options), camera, options);
}

double loss(const Model& model, const Camera& camera, std::span<const double> target,
            const Options& options) {
  const Render image = render(model, camera, options);
  return (1 - options.lambda_dssim) * mean_absolute(image.image, target) +
         options.lambda_dssim * (1 - ssim(image.image, target, 3, camera.height, camera.width));
}

Gradient gradient(const Model& model, const Camera& camera, std::span<const double> target,
                  const Options& options) {
  const Frame frame = make_frame(project(model, camera, options), camera, options);
  const Render image = render_frame(frame, camera, options);
  Gradient result;
  result.l1 = mean_absolute(image.image, target);
  result.dssim = 1 - ssim(image.image, target, 3, camera.height, camera.width);
  result.loss = (1 - options.lambda_dssim) * result.l1 + options.lambda_dssim * result.dssim;
  result.values.assign(model.values.size(), 0.0);

  const std::vector<FootprintGradient> footprints =
      footprint_gradients(
          frame, camera, options,
          image_gradient(image.image, target, camera.width, camera.height, options.lambda_dssim));
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
