// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/truth.hpp"

#include <cmath>

#include "host/base/error.hpp"
#include "kernels/layout.h"

namespace ubs::accuracy {
namespace {

constexpr float kFarAway = -1e6f;  // [px]
constexpr float kReach = 9;        // r beyond which no kernel has a part

std::vector<double> as_double(std::span<const float> values) { return {values.begin(), values.end()}; }
std::vector<float> rounded(std::span<const double> values) {
  std::vector<float> result(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) result[i] = static_cast<float>(values[i]);
  return result;
}

double loss_of(std::span<const double> image, std::span<const double> target, const Problem& p) {
  return oracle::image_loss(image, target, p.camera.width, p.camera.height, p.lambda_dssim);
}

// d loss / d image, nothing where the problem says that pixels are not decided.
std::vector<double> image_gradient(const Problem& p, std::span<const double> image,
                                   std::span<const double> target) {
  std::vector<double> v =
      oracle::image_gradient(image, target, p.camera.width, p.camera.height, p.lambda_dssim);
  for (std::size_t i = 0; !p.undecided.empty() && i < v.size(); ++i)
    if (p.undecided[i % p.undecided.size()]) v[i] = 0;
  return v;
}

// Q = L^T L with L = [[L00, L01], [0, L11]], as the records have it.
std::array<double, 3> factor(const std::array<double, 3>& q) {
  const double l00 = std::sqrt(q[0]), l01 = q[1] / l00;
  return {l00, l01, std::sqrt(std::max(0.0, q[2] - l01 * l01))};
}

Record record_of(const oracle::Footprint<double>& f, const std::array<double, 3>& l) {
  Record r{};
  if (!f.visible) {
    r[kSplatX] = r[kSplatY] = kFarAway;
    r[kSplatL00] = r[kSplatL11] = 1;
    return r;
  }
  const double values[] = {f.mean[0], f.mean[1], l[0],     l[1],     l[2],
                           f.opacity, f.beta,    f.rgb[0], f.rgb[1], f.rgb[2]};
  for (std::size_t k = 0; k < std::size(values); ++k) r[k] = static_cast<float>(values[k]);
  r[kSplatDepth] = static_cast<float>(f.depth);
  r[kSplatReach] = kReach;
  return r;
}

oracle::Footprint<double> footprint_of(const Record& r, bool visible) {
  const double l00 = r[kSplatL00], l01 = r[kSplatL01], l11 = r[kSplatL11];
  oracle::Footprint<double> f;
  f.mean = {r[kSplatX], r[kSplatY]};
  f.conic = {l00 * l00, l00 * l01, l01 * l01 + l11 * l11};
  f.cov = {(1 + l01 * l01 / (l11 * l11)) / (l00 * l00), -l01 / (l00 * l11 * l11), 1 / (l11 * l11)};
  f.opacity = r[kSplatOpacity];
  f.beta = r[kSplatBeta];
  f.rgb = {r[kSplatR], r[kSplatG], r[kSplatB]};
  f.depth = r[kSplatDepth];
  f.visible = visible;
  return f;
}

void round_projection(StageTruth& t) {
  for (const auto& f : t.footprints) {
    t.factors.push_back(f.visible ? factor(f.conic) : std::array<double, 3>{1, 0, 1});
    t.records.push_back(record_of(f, t.factors.back()));
  }
}

// The product's gradient of the ellipse is W = -L Q' L^T for the gradient Q' of the conic Q = L^T L, in whose
// packed form the off-diagonal entry counts twice (kernels/math/blend.h). The other values are the same in
// both, and so is the order: kGrad* and the oracle's footprint gradient.
oracle::FootprintGradient to_ellipse(oracle::FootprintGradient g, const Record& r) {
  const double l00 = r[kSplatL00], l01 = r[kSplatL01], l11 = r[kSplatL11];
  const double m00 = -g[kGradW00], m01 = -g[kGradW01] / 2, m11 = -g[kGradW11];
  g[kGradW00] = l00 * l00 * m00 + 2 * l00 * l01 * m01 + l01 * l01 * m11;
  g[kGradW01] = l11 * (l00 * m01 + l01 * m11);
  g[kGradW11] = l11 * l11 * m11;
  return g;
}

oracle::FootprintGradient from_ellipse(oracle::FootprintGradient g, const std::array<double, 3>& l) {
  const double m11 = g[kGradW11] / (l[2] * l[2]);
  const double m01 = (g[kGradW01] / l[2] - l[1] * m11) / l[0];
  const double m00 = (g[kGradW00] - 2 * l[0] * l[1] * m01 - l[1] * l[1] * m11) / (l[0] * l[0]);
  g[kGradW00] = -m00, g[kGradW01] = -2 * m01, g[kGradW11] = -m11;
  return g;
}

void scatter(StageTruth& t, const oracle::Frame& frame, std::span<const oracle::FootprintGradient> v) {
  t.v_footprints.assign(t.footprints.size(), oracle::FootprintGradient{});
  t.v_records.assign(t.footprints.size(), Record{});
  for (std::size_t k = 0; k < frame.splats.size(); ++k) {
    const oracle::FootprintGradient g = to_ellipse(v[k], t.records[frame.splats[k]]);
    t.v_footprints[frame.splats[k]] = g;
    for (std::size_t j = 0; j < g.size(); ++j) t.v_records[frame.splats[k]][j] = static_cast<float>(g[j]);
  }
}

}  // namespace

oracle::Options oracle_options(const Problem& p) {
  oracle::Options options;
  options.near_plane = p.near_plane;
  options.far_plane = p.far_plane;
  options.eps2d = p.eps2d;
  options.lambda_dssim = p.lambda_dssim;
  options.query_grad = p.query_grad;
  options.variant = p.model.variant;
  for (std::size_t c = 0; c < 3; ++c) options.background[c] = p.background[c];
  return options;
}

std::vector<float> planar_target(const Image8& image) {
  const std::size_t pixels = image.rgb.size() / 3;
  std::vector<float> planes(image.rgb.size());
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < pixels; ++i)
      planes[c * pixels + i] = static_cast<float>(image.rgb[3 * i + c]) / 255.0f;
  return planes;
}

Truth compute_truth(const Problem& p) {
  const oracle::Options options = oracle_options(p);
  const oracle::Model model = oracle::to_model(p.model);
  const std::vector<double> target = as_double(p.target);
  const oracle::Frame frame(oracle::project(model, p.camera, options), options);
  Truth truth;
  truth.image = oracle::render_frame(frame, p.camera, options).image;
  truth.loss = loss_of(truth.image, target, p);
  truth.v_image = image_gradient(p, truth.image, target);
  const auto v = oracle::footprint_gradients(frame, p.camera, options, truth.v_image);
  truth.gradient = oracle::parameter_gradients(frame, model, p.camera, options, v);
  return truth;
}

StageTruth compute_stage_truth(const Problem& p) {
  const oracle::Options options = oracle_options(p);
  const oracle::Model model = oracle::to_model(p.model);
  const std::vector<double> target = as_double(p.target);
  StageTruth t;
  t.footprints = oracle::project(model, p.camera, options);
  round_projection(t);

  std::vector<oracle::Footprint<double>> exact;
  for (std::size_t i = 0; i < t.records.size(); ++i)
    exact.push_back(footprint_of(t.records[i], t.footprints[i].visible));
  const oracle::Frame frame = oracle::Frame(exact, options);
  t.image = oracle::render_frame(frame, p.camera, options).image;
  t.image_rounded = rounded(t.image);

  const std::vector<double> image = as_double(t.image_rounded);
  t.loss = loss_of(image, target, p);
  t.v_image = image_gradient(p, image, target);
  t.v_image_rounded = rounded(t.v_image);

  scatter(t, frame, oracle::footprint_gradients(frame, p.camera, options, as_double(t.v_image_rounded)));
  std::vector<oracle::FootprintGradient> v;
  for (const std::size_t i : frame.splats) {
    oracle::FootprintGradient g{};
    for (std::size_t j = 0; j < g.size(); ++j) g[j] = t.v_records[i][j];
    v.push_back(from_ellipse(g, t.factors[i]));  // project_backward has the exact model, so the exact ellipse
  }
  t.v_params = oracle::parameter_gradients(frame, model, p.camera, options, v);
  return t;
}

}  // namespace ubs::accuracy
