// SPDX-License-Identifier: Apache-2.0
#include "host/stress/sweep_reference.hpp"

#include "host/stress/wide_tape.hpp"
// The oracle's formulas are templates over the scalar; its own double and tape are not used here.
#include "tests/reference/splat_formula.hpp"

namespace ubs::stress {
namespace {

constexpr double kReach = 500;  // [px]: an image's width

oracle::Options options_of(const SweepSet& set) {
  oracle::Options options{.variant = set.variant};
  options.near_plane = static_cast<double>(set.settings.near_plane);
  options.far_plane = static_cast<double>(set.settings.far_plane);
  options.eps2d = static_cast<double>(set.settings.eps2d);
  return options;
}

struct Factor {  // of the conic, Q = L^T L
  double l00, l01, l11;
};

Factor factor_of(const oracle::Footprint<Wide>& f) {
  const Wide l00 = sqrt(f.conic[0]), l01 = f.conic[1] / l00;
  return {value(l00), value(l01), value(sqrt(f.conic[2] - l01 * l01))};
}

Wide pixel_alpha(const oracle::Footprint<Wide>& f, float x, float y) {
  const Wide r = oracle::kernel_radius<Wide>(f, static_cast<double>(x), static_cast<double>(y));
  if (value(r) >= 1) return Wide(0.0);
  return oracle::splat_alpha<Wide>(f, r);
}

}  // namespace

bool choose_points(const SweepSet& set, const SweepSplat& splat, Generator& g, std::vector<float>& x,
                   std::vector<float>& y) {
  const oracle::Rows rows(set.dim, set.variant);
  const std::vector<Wide> raw(splat.raw.begin(), splat.raw.end());
  const auto f = oracle::footprint<Wide>(std::span<const Wide>(raw), rows, set.camera, options_of(set));
  if (!f.visible) return false;
  const Factor l = factor_of(f);
  for (int k = 0; k < kSweepPoints; ++k) {
    const double radius = std::sqrt(splat.radius2 * (k + uniform(g, 0, 1)) / kSweepPoints);
    const double angle = uniform(g, 0, 6.283185307179586);
    double p = radius * std::cos(angle), dy = radius * std::sin(angle) / l.l11;
    const double length = std::hypot((p - l.l01 * dy) / l.l00, dy);
    if (length > kReach) dy *= kReach / length;
    double dx = (p - l.l01 * dy) / l.l00;
    if (std::abs(dx) > kReach) dx *= kReach / std::abs(dx);
    x.push_back(static_cast<float>(value(f.mean[0]) - dx));
    y.push_back(static_cast<float>(value(f.mean[1]) - dy));
  }
  return true;
}

SplatReference splat_reference(const SweepSet& set, std::span<const double> raw, std::span<const float> x,
                               std::span<const float> y, std::span<const float> v_image) {
  WideTape tape;
  std::vector<Wide> inputs;
  for (const double v : raw) inputs.push_back(Wide::input(tape, v));
  const auto f = oracle::footprint<Wide>(std::span<const Wide>(inputs), oracle::Rows(set.dim, set.variant),
                                         set.camera, options_of(set));
  SplatReference out;
  out.visible = f.visible;
  if (!f.visible) return out;
  out.image.resize(3 * x.size());
  Wide loss(0.0);
  for (std::size_t k = 0; k < x.size(); ++k) {
    const Wide alpha = pixel_alpha(f, x[k], y[k]);
    for (std::size_t c = 0; c < 3; ++c) {
      const Wide colour = alpha * f.rgb[c];
      out.image[c * x.size() + k] = value(colour);
      loss += colour * static_cast<double>(v_image[c * x.size() + k]);
    }
  }
  out.gradient = tape.gradient(loss.node(), inputs.size());
  return out;
}

StackReference stack_reference(std::span<const double> fields, std::span<const float> x,
                               std::span<const float> y, std::span<const float> v_image) {
  const std::size_t points = x.size();
  StackReference out{std::vector<double>(3 * points), std::vector<double>(fields.size())};
  WideTape tape;
  for (std::size_t k = 0; k < points; ++k) {
    tape.clear();
    std::vector<Wide> in;
    for (const double v : fields) in.push_back(Wide::input(tape, v));
    Wide open(1.0), loss(0.0);
    for (std::size_t at = 0; at < in.size(); at += kStackFields) {
      oracle::Footprint<Wide> f;
      const Wide *s = &in[at], &l00 = s[2], &l01 = s[3], &l11 = s[4];
      f.mean = {s[0], s[1]};
      f.conic = {l00 * l00, l00 * l01, l01 * l01 + l11 * l11};
      f.opacity = s[5], f.beta = s[6], f.rgb = {s[7], s[8], s[9]};
      const Wide alpha = pixel_alpha(f, x[k], y[k]);
      const Wide next = open * (1.0 - alpha);
      if (value(next) <= oracle::kMinTransmittance) break;
      for (std::size_t c = 0; c < 3; ++c) {
        const Wide part = open * alpha * f.rgb[c];
        out.image[c * points + k] += value(part);
        loss += part * static_cast<double>(v_image[c * points + k]);
      }
      open = next;
    }
    const std::vector<double> g = tape.gradient(loss.node(), in.size());
    for (std::size_t i = 0; i < g.size(); ++i) out.gradient[i] += g[i];
  }
  // From the factor L to W (EllipseVjp of kernels/math/ellipse.h): W = -sym(v_L L^T) / 2 above the diagonal.
  for (std::size_t at = 0; at < fields.size(); at += kStackFields) {
    double* v = &out.gradient[at];
    const double l00 = fields[at + 2], l01 = fields[at + 3], l11 = fields[at + 4];
    const double w00 = -0.5 * (v[2] * l00 + v[3] * l01), w01 = -0.5 * v[3] * l11, w11 = -0.5 * v[4] * l11;
    v[2] = w00, v[3] = w01, v[4] = w11;
  }
  return out;
}

}  // namespace ubs::stress
