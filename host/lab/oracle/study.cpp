// SPDX-License-Identifier: Apache-2.0
// This file implements study.hpp. The tape propagates the rounding of the inputs to the footprint. J is the
// Jacobian of the values that a pixel reads, and d contains the rounding errors of the inputs. The covariance
// J diag(d^2) J^T then gives the deviation of any smooth function of the footprint.
#include "host/lab/oracle/study.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/lab/oracle/frame.hpp"
#include "host/lab/oracle/oracle_stages.hpp"
#include "host/lab/oracle/scenes.hpp"

namespace ubs::oracle {
namespace {

// Maximum number of splats for which gradient_cancellation() is computed.
constexpr std::size_t kMaxCancelling = 64;
constexpr double kHalfUlp = 0x1p-24;
// This width is added to the rounding error of r before |r - 1| is compared with it.
constexpr double kRimWidth = 2e-6;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
// A decision that rounding may change matters only if it changes the weight of a colour by more than
// kMaterialWeight, or the slope of alpha in r by more than kMaterialSlope.
constexpr double kMaterialWeight = 1e-6, kMaterialSlope = 1e-4;

// A pixel reads these values of a splat: the mean x, y, the factor l00, l01, l11 of the conic, for which r =
// (l00 dx + l01 dy)^2 + (l11 dy)^2, and the logarithm of the opacity. The enumeration also contains the two
// outputs that decide whether the splat is culled.
constexpr int kReadings = 6;
enum { kX, kY, kL00, kL01, kL11, kLogOpacity, kDepth, kSmallAxis, kOutputs };

// Rounding describes the rounding errors of the footprint of a splat.
struct Rounding {
  std::array<double, kReadings> value{};
  std::array<std::array<double, kReadings>, kReadings> covariance{};
  double depth = 0;       // standard deviation of the depth
  double small_axis = 0;  // standard deviation of det / trace of the ellipse
};

struct Box {
  double left = -kInfinity, right = kInfinity, top = -kInfinity, bottom = kInfinity;
  bool holds(double x, double y) const { return x >= left && x <= right && y >= top && y <= bottom; }
};

std::vector<double> query_values(const std::vector<double>& raw, const Rows& rows, const Camera& camera) {
  return query_vector<double>(raw, rows, camera, false);
}

// Returns the rounding error of each raw parameter. If the formulas only use the difference between a
// parameter and the camera centre or the query, the result is the rounding error of this difference. The
// parameter itself is an exact input without a rounding error, even if it is large.
std::vector<double> input_rounding(const std::vector<double>& raw, const Rows& rows, const Camera& camera) {
  std::vector<double> size;
  for (double x : raw) size.push_back(std::isfinite(x) ? kHalfUlp * std::abs(x) : 0.0);
  const std::array<double, 3> centre = camera_centre(camera);
  for (int i = 0; i < 3; ++i) size[rows.xyz + i] = kHalfUlp * std::abs(raw[rows.xyz + i] - centre[i]);
  const std::vector<double> query = query_values(raw, rows, camera);
  for (int i = 0; i < rows.query; ++i) {
    size[rows.mean + i] = kHalfUlp * std::abs(query[i] - raw[rows.mean + i]);
    if (rows.query >= 3 && i < 3) size[rows.mean + i] += kHalfUlp * std::abs(query[i]);
  }
  for (double& s : size)
    if (!std::isfinite(s)) s = 0;
  return size;
}

Rounding rounding_of(const std::vector<double>& raw, const Rows& rows, const Camera& camera,
                     const Options& options, Tape& tape) {
  tape.clear();
  std::vector<Var> inputs;
  for (double x : raw) inputs.push_back(Var::input(tape, x));
  const std::array<Var, 3> shift{Var::input(tape, 0), Var::input(tape, 0), Var::input(tape, 0)};
  const Footprint<Var> f = footprint<Var>(inputs, rows, camera, options, &shift);
  std::vector<double> size = input_rounding(raw, rows, camera);
  for (const Var& s : shift) {
    inputs.push_back(s);
    size.push_back(kHalfUlp * f.reach);
  }
  std::array<Var, kOutputs> outputs{};
  outputs[kDepth] = f.depth;
  if (f.in_range) {
    const Var det = f.cov[0] * f.cov[2] - f.cov[1] * f.cov[1];
    const Var l00 = sqrt(f.cov[2] / det);
    outputs[kX] = f.mean[0], outputs[kY] = f.mean[1];
    outputs[kL00] = l00, outputs[kL01] = -(f.cov[1] / f.cov[2]) * l00, outputs[kL11] = 1.0 / sqrt(f.cov[2]);
    outputs[kLogOpacity] = f.opacity.value() > 0 ? f.opacity / f.opacity.value() : Var(1);
    outputs[kSmallAxis] = det / (f.cov[0] + f.cov[2]);
  }
  std::vector<std::array<double, kOutputs>> jacobian(inputs.size());
  for (int o = 0; o < kOutputs; ++o) {
    if (outputs[o].node() == Tape::kConstant) continue;
    tape.forget_adjoints();
    tape.seed(outputs[o].node(), 1);
    tape.reverse();
    for (std::size_t i = 0; i < inputs.size(); ++i) jacobian[i][o] = tape.adjoint(inputs[i].node()) * size[i];
  }
  Rounding result;
  double depth = 0, axis = 0;
  for (const auto& row : jacobian) {
    depth += row[kDepth] * row[kDepth];
    axis += row[kSmallAxis] * row[kSmallAxis];
    for (int a = 0; a < kReadings; ++a)
      for (int b = 0; b < kReadings; ++b) result.covariance[a][b] += row[a] * row[b];
  }
  result.depth = std::sqrt(depth), result.small_axis = std::sqrt(axis);
  for (int a = 0; a < kReadings; ++a) {
    result.value[a] = outputs[a].value();
    const double stored = a == kLogOpacity ? kHalfUlp : kHalfUlp * result.value[a];
    result.covariance[a][a] += stored * stored;
  }
  return result;
}

double deviation(const Rounding& s, const std::array<double, kReadings>& slope) {
  double sum = 0;
  for (int a = 0; a < kReadings; ++a)
    for (int b = 0; b < kReadings; ++b) sum += slope[a] * s.covariance[a][b] * slope[b];
  return std::sqrt(std::max(0.0, sum));
}

// PixelSample contains the values of one splat at one pixel.
struct PixelSample {
  double r = 0, r_rounding = 0;
  double alpha = 0, alpha_rounding = 0;  // before alpha is limited to its maximum
};

PixelSample meet(const Footprint<double>& f, const Rounding& s, double x, double y, double margin,
                 SpatialKernel kernel) {
  const double dx = f.mean[0] - x, dy = f.mean[1] - y;
  const double p = s.value[kL00] * dx + s.value[kL01] * dy, q = s.value[kL11] * dy;
  PixelSample m;
  m.r = kernel_radius<double>(f, x, y);
  const std::array<double, kReadings> slope{2 * p * s.value[kL00],
                                            2 * p * s.value[kL01] + 2 * q * s.value[kL11],
                                            2 * p * dx,
                                            2 * p * dy,
                                            2 * q * dy,
                                            0};
  m.r_rounding = margin * (deviation(s, slope) + 2 * kHalfUlp * m.r);
  // A kernel that no limit of alpha ends is 0 outside of its support.
  const KernelLimits limits = limits_of(kernel);
  m.alpha = limits.least > 0 || m.r < limits.support ? f.opacity * kernel_value(kernel, m.r, f.beta) : 0.0;
  const double relative = kernel_slope(kernel, m.r, f.beta);
  const double opacity = margin * std::sqrt(s.covariance[kLogOpacity][kLogOpacity]);
  m.alpha_rounding = m.alpha * std::min(1.0, relative * m.r_rounding + opacity);
  return m;
}

// Returns whether rounding decides if the pixel is inside the support, and alpha or its slope is large enough
// at the edge of the support for this to matter.
bool at_rim(const Footprint<double>& f, const PixelSample& m, SpatialKernel kernel) {
  const KernelLimits limits = limits_of(kernel);
  if (limits.least > 0) return std::abs(m.alpha - limits.least) < m.alpha_rounding;
  const double width = m.r_rounding + kRimWidth;
  if (!(std::abs(m.r - limits.support) < width)) return false;
  const double edge = std::max(0.0, limits.support - 2 * width);
  const double inside = f.opacity * kernel_value(kernel, edge, f.beta);
  return inside > kMaterialWeight || inside * kernel_slope(kernel, edge, f.beta) > kMaterialSlope;
}

// PixelStudy determines whether the decisions at a pixel are certain. undecided() returns true if rounding
// may change one of them.
class PixelStudy {
 public:
  PixelStudy(const Frame& frame, const std::vector<Rounding>& rounding, double margin, SpatialKernel kernel)
      : frame_(frame), rounding_(rounding), margin_(margin), kernel_(kernel) {}

  bool undecided(const std::vector<int>& candidates, double x, double y) const {
    const double cap = limits_of(kernel_).most;
    double transmittance = 1, variance = 0, last_weight = 0;
    int last = -1;
    for (int k : candidates) {
      const Footprint<double>& f = frame_.footprints[k];
      if (!(std::abs(f.mean[0] - x) <= frame_.half_width[k])) continue;
      const PixelSample m = meet(f, rounding_[k], x, y, margin_, kernel_);
      if (at_rim(f, m, kernel_)) return true;
      if (!reaches(f, m.r, kernel_)) continue;
      if (std::abs(m.alpha - cap) < m.alpha_rounding) return true;
      const double alpha = std::min(m.alpha, cap), next = transmittance * (1 - alpha);
      const double relative = m.alpha > cap ? 0 : m.alpha_rounding / (1 - alpha);
      variance += relative * relative;
      const double weight = alpha * transmittance;
      const double stop_rounding = next * (std::sqrt(variance) + margin_ * kHalfUlp);
      if (std::abs(next - kMinTransmittance) < stop_rounding && weight > kMaterialWeight) return true;
      if (next <= kMinTransmittance) break;
      if (last >= 0 && tied(last, k) && std::min(alpha, 1.0) * last_weight > kMaterialWeight) return true;
      transmittance = next, last = k, last_weight = weight;
    }
    return false;
  }

 private:
  bool tied(int a, int b) const {
    const double gap = frame_.footprints[b].depth - frame_.footprints[a].depth;
    return gap != 0 && std::abs(gap) < margin_ * std::hypot(rounding_[a].depth, rounding_[b].depth);
  }

  const Frame& frame_;
  const std::vector<Rounding>& rounding_;
  double margin_;
  SpatialKernel kernel_;
};

// Returns the rectangle of pixels that a splat may affect. It is unlimited if the footprint is not known.
Box box_of(const Footprint<double>& f, double support) {
  if (!f.in_range) return {};
  const double w = 1.05 * std::sqrt(support * std::abs(f.cov[0])) + 1,
               h = 1.05 * std::sqrt(support * std::abs(f.cov[2])) + 1;
  const Box box{f.mean[0] - w, f.mean[0] + w, f.mean[1] - h, f.mean[1] + h};
  return std::isfinite(box.left + box.right + box.top + box.bottom) ? box : Box{};
}

// Returns whether rounding may change the decision to cull the splat.
bool undecided_cull(const Footprint<double>& f, const Rounding& s, const Options& options, double margin) {
  const double depth = margin * s.depth;
  if (std::abs(f.depth - options.near_plane) < depth || std::abs(f.depth - options.far_plane) < depth)
    return true;
  if (!f.in_range) return false;
  const double trace = f.cov[0] + f.cov[2], det = f.cov[0] * f.cov[2] - f.cov[1] * f.cov[1];
  const double least = std::max(0.0, least_determinant(f.cov, options.eps2d));
  return std::abs((det - least) / trace) < margin * s.small_axis;
}

// Returns whether the determinant of the ellipse is within the rounding errors of its terms. Then a
// single-precision program may render the splat although the ellipse is indefinite.
bool lost_determinant(const Footprint<double>& f) { return f.in_range && 4 * kHalfUlp * f.amplification > 1; }

// Moved contains a model, a camera and weights whose numbers are changed at random by about half a unit in
// the last place of single precision. The changes are independent, with one exception: the translation of the
// camera is computed from the changed rotation, so that the camera centre stays the same.
struct Moved {
  Model model;
  Camera camera;
  std::vector<double> weights;
};

Moved moved(const Model& model, const Camera& camera, const std::vector<double>& weights,
            const Options& options, std::uint64_t seed) {
  Random random(seed);
  const Rows rows(model.dim, options.variant);
  Moved m{model, camera, weights};
  for (std::size_t i = 0; i < model.count; ++i) {
    const std::vector<double> raw = splat_parameters(model, rows, i);
    const std::vector<double> size = input_rounding(raw, rows, camera);
    for (int r = 0; r < rows.count; ++r)
      m.model.values[r * model.count + i] += size[r] * random.uniform(-1, 1);
  }
  const auto move = [&](double& x, double size) { x += kHalfUlp * size * random.uniform(-1, 1); };
  const std::array<double, 3> centre = camera_centre(camera);
  for (double& x : m.camera.rotation) move(x, std::abs(x));
  for (int i = 0; i < 3; ++i) {  // the rotation changes, but the centre stays the same
    m.camera.translation[i] = 0;
    for (int k = 0; k < 3; ++k) m.camera.translation[i] -= m.camera.rotation[3 * i + k] * centre[k];
  }
  move(m.camera.fx, camera.fx), move(m.camera.fy, camera.fy);
  move(m.camera.cx, std::max<double>(std::abs(camera.cx), camera.width));
  move(m.camera.cy, std::max<double>(std::abs(camera.cy), camera.height));
  for (double& w : m.weights) move(w, w);
  return m;
}

void describe_drawn(const Frame& frame, const Options& options, Study& result) {
  double brightest = 0, darkest = kInfinity;
  for (double b : options.background) brightest = std::max(brightest, std::abs(b));
  for (std::size_t k = 0; k < frame.splats.size(); ++k) {
    const Footprint<double>& f = frame.footprints[k];
    result.amplification = std::max(result.amplification, f.amplification);
    const double light = std::hypot(f.rgb[0], f.rgb[1], f.rgb[2]);
    brightest = std::max(brightest, light), darkest = std::min(darkest, light);
    result.floored += f.guards.pivot;
  }
  if (darkest > 0 && darkest < kInfinity) result.colour_contrast = std::max(1.0, brightest / darkest);
}

}  // namespace

Study study(const Model& model, const Camera& camera, const std::vector<double>& weights,
            const Options& options, const StudyOptions& how) {
  const Frame frame(model, camera, options);
  const Rows rows(model.dim, options.variant);
  Study result;
  result.image = render(model, camera, options);
  result.drawn = frame.splats.size();
  result.culled.assign(model.count, 0);
  describe_drawn(frame, options, result);

  Tape tape;
  std::vector<Rounding> rounding;
  std::vector<Box> boxes;
  const auto doubt = [&](const Footprint<double>& f) {
    boxes.push_back(box_of(f, limits_of(options.variant.kernel).support));
    ++result.undecided_splats;
  };
  for (std::size_t k = 0; k < frame.splats.size(); ++k) {
    const Footprint<double>& f = frame.footprints[k];
    rounding.push_back(
        rounding_of(splat_parameters(model, rows, frame.splats[k]), rows, camera, options, tape));
    if (how.margin > 0 &&
        (f.guards.out_of_range || f.guards.kink || undecided_cull(f, rounding.back(), options, how.margin)))
      doubt(f);
  }
  for (std::size_t k = 0; k < frame.culled.size(); ++k) {
    const std::vector<double> raw = splat_parameters(model, rows, frame.culled_splats[k]);
    const Footprint<double>& f = frame.culled[k];
    const bool doubtful =
        how.margin > 0 && in_raw_range<double>(raw) && std::isfinite(f.depth) &&
        (f.guards.out_of_range || lost_determinant(f) ||
         undecided_cull(f, rounding_of(raw, rows, camera, options, tape), options, how.margin));
    if (doubtful)
      doubt(f);
    else
      result.culled[frame.culled_splats[k]] = 1;
  }

  const std::size_t pixels = static_cast<std::size_t>(camera.width) * camera.height;
  result.undecided.assign(pixels, 0);
  const PixelStudy pixel_study(frame, rounding, how.margin, options.variant.kernel);
  for (int row = 0; how.margin > 0 && row < camera.height; ++row) {
    const std::vector<int> candidates = frame.reaching_row(row + 0.5);
    for (int column = 0; column < camera.width; ++column) {
      const double x = column + 0.5, y = row + 0.5;
      const bool undecided = pixel_study.undecided(candidates, x, y) ||
                             std::ranges::any_of(boxes, [&](const Box& box) { return box.holds(x, y); });
      result.undecided[static_cast<std::size_t>(row) * camera.width + column] = undecided;
      result.undecided_pixels += undecided;
    }
  }

  std::vector<double> decided = weights;
  for (std::size_t i = 0; i < pixels; ++i)
    if (result.undecided[i]) decided[i] = decided[pixels + i] = decided[2 * pixels + i] = 0;
  if (how.gradient) {
    result.gradient = weighted_gradient(model, camera, decided, options);
    if (frame.splats.size() <= kMaxCancelling)
      result.gradient_cancellation = gradient_cancellation(frame, model, camera, options, decided);
  }
  for (int n = 0; n < how.neighbours; ++n) {
    const Moved m = moved(model, camera, decided, options, how.seed + static_cast<std::uint64_t>(n));
    Neighbour neighbour;
    neighbour.image = render(m.model, m.camera, options).image;
    if (how.gradient) neighbour.gradient = weighted_gradient(m.model, m.camera, m.weights, options);
    result.neighbours.push_back(std::move(neighbour));
  }
  return result;
}

}  // namespace ubs::oracle
