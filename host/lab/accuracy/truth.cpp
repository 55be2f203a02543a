// SPDX-License-Identifier: Apache-2.0
#include "host/lab/accuracy/truth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

#include "host/lab/oracle/oracle_stages.hpp"
#include "kernels/layout.h"

namespace ubs::accuracy {
namespace {

constexpr float kFarAway = -1e6f;  // position of invisible splats, far outside the image [px]
// No kernel has an effect beyond this squared distance r (UBS_SUPPORT in kernels/variant.h).
constexpr float kReach = 11.1f;

using Factor = std::array<double, 3>;  // L00, L01, L11

std::vector<double> as_double(std::span<const float> values) { return {values.begin(), values.end()}; }
// Returns the values rounded to float32.
std::vector<double> as_rounded(const std::vector<double>& values) {
  return as_double(check::rounded(values));
}

double loss_of(std::span<const double> image, std::span<const double> target, const Problem& p) {
  return oracle::image_loss(image, target, p.camera.width, p.camera.height, p.loss);
}

// Returns d loss / d image. It is 0 at pixels that the problem marks as undecided.
std::vector<double> image_gradient(const Problem& p, std::span<const double> image,
                                   std::span<const double> target) {
  std::vector<double> v = oracle::image_gradient(image, target, p.camera.width, p.camera.height, p.loss);
  for (std::size_t i = 0; !p.undecided.empty() && i < v.size(); ++i)
    if (p.undecided[i % p.undecided.size()]) v[i] = 0;
  return v;
}

// Returns the factor L = [[L00, L01], [0, L11]] of the conic Q = L^T L. The records of projected splats
// contain this factor (kernels/layout.h).
Factor factor(const std::array<double, 3>& q) {
  const double l00 = std::sqrt(q[0]), l01 = q[1] / l00;
  return {l00, l01, std::sqrt(std::max(0.0, q[2] - l01 * l01))};
}

void put_record(const oracle::Footprint<double>& f, const Factor& l, double* r) {
  if (!f.visible) {
    r[kSplatX] = r[kSplatY] = kFarAway;
    r[kSplatL00] = r[kSplatL11] = 1;
    return;
  }
  const double values[] = {f.mean[0], f.mean[1], l[0],     l[1],     l[2],
                           f.opacity, f.beta,    f.rgb[0], f.rgb[1], f.rgb[2]};
  std::ranges::copy(values, r);
  r[kSplatDepth] = f.depth;
  r[kSplatReach] = kReach;
}

oracle::Footprint<double> footprint_of(const double* r, bool visible) {
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

// Converts the gradient of the conic to that of the ellipse, which the kernels use: W = -L Q' L^T for the
// gradient Q' of the conic Q = L^T L. In the packed form of Q' the off-diagonal entry counts twice
// (kernels/math/blend.h). The other values, and the order of all values, are the same in kGrad* and in the
// footprint gradient of the oracle.
oracle::FootprintGradient to_ellipse(oracle::FootprintGradient g, const double* r) {
  const double l00 = r[kSplatL00], l01 = r[kSplatL01], l11 = r[kSplatL11];
  const double m00 = -g[kGradW00], m01 = -g[kGradW01] / 2, m11 = -g[kGradW11];
  g[kGradW00] = l00 * l00 * m00 + 2 * l00 * l01 * m01 + l01 * l01 * m11;
  g[kGradW01] = l11 * (l00 * m01 + l01 * m11);
  g[kGradW11] = l11 * l11 * m11;
  return g;
}

oracle::FootprintGradient from_ellipse(oracle::FootprintGradient g, const Factor& l) {
  const double m11 = g[kGradW11] / (l[2] * l[2]);
  const double m01 = (g[kGradW01] / l[2] - l[1] * m11) / l[0];
  const double m00 = (g[kGradW00] - 2 * l[0] * l[1] * m01 - l[1] * l[1] * m11) / (l[0] * l[0]);
  g[kGradW00] = -m00, g[kGradW01] = -2 * m01, g[kGradW11] = -m11;
  return g;
}

}  // namespace

oracle::Options oracle_options(const Problem& p) {
  oracle::Options options;
  options.near_plane = p.near_plane;
  options.far_plane = p.far_plane;
  options.eps2d = p.eps2d;
  options.loss = p.loss;
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
  oracle::Render render = oracle::render_frame(frame, p.camera, options);
  truth.image = std::move(render.image);
  truth.contributions = std::accumulate(render.contributors.begin(), render.contributors.end(), 0.0) /
                        static_cast<double>(render.contributors.size());
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
  const std::vector<oracle::Footprint<double>> footprints = oracle::project(model, p.camera, options);
  const std::size_t count = footprints.size();
  StageTruth t;
  t.records.assign(count * kSplatStride, 0);
  std::vector<Factor> factors;
  for (std::size_t i = 0; i < count; ++i) {
    t.visible.push_back(footprints[i].visible);
    factors.push_back(footprints[i].visible ? factor(footprints[i].conic) : Factor{1, 0, 1});
    put_record(footprints[i], factors[i], &t.records[i * kSplatStride]);
  }

  const std::vector<double> records = as_rounded(t.records);
  std::vector<oracle::Footprint<double>> exact;
  for (std::size_t i = 0; i < count; ++i)
    exact.push_back(footprint_of(&records[i * kSplatStride], footprints[i].visible));
  const oracle::Frame frame = oracle::Frame(exact, options);
  t.image = oracle::render_frame(frame, p.camera, options).image;

  const std::vector<double> image = as_rounded(t.image);
  t.loss = loss_of(image, target, p);
  t.v_image = image_gradient(p, image, target);

  const auto v = oracle::footprint_gradients(frame, p.camera, options, as_rounded(t.v_image));
  t.v_records.assign(count * kGradStride, 0);
  for (std::size_t k = 0; k < frame.splats.size(); ++k) {
    const std::size_t i = frame.splats[k];
    std::ranges::copy(to_ellipse(v[k], &records[i * kSplatStride]), &t.v_records[i * kGradStride]);
  }

  const std::vector<double> v_records = as_rounded(t.v_records);
  std::vector<oracle::FootprintGradient> given;
  for (const std::size_t i : frame.splats) {
    oracle::FootprintGradient g{};
    std::copy_n(&v_records[i * kGradStride], g.size(), g.begin());
    given.push_back(
        // project_backward computes the ellipse from the exact model, so use the exact factor here instead of
        // the rounded one in the records.
        from_ellipse(g, factors[i]));
  }
  t.v_params = oracle::parameter_gradients(frame, model, p.camera, options, given);
  return t;
}

}  // namespace ubs::accuracy
