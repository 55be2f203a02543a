// SPDX-License-Identifier: Apache-2.0
#include "host/train/fit_camera.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "host/base/vector3.hpp"
#include "host/train/pyramid.hpp"

namespace ubs {
namespace {

// Step of the finite differences, in pixels. It is smaller than a pixel, because renders change smoothly over
// such a distance.
constexpr double kStepPixels = 0.25;
constexpr double kSettledPixels = 5e-3;  // the fit ends when a step moves the image by less [px]
// Maximum of each number of a step (CameraMove, roughly in radians).
constexpr double kMaxStep = 0.03;
constexpr int kFittingSteps = 20;  // maximum number of steps for each size of the image
// The search compares shifts by up to this number of pixels of the reduced image, in both directions of each
// axis. Without this search, the steps that follow may end in a local minimum near the first pose.
constexpr int kSearched = 3;
// Damping of the Levenberg-Marquardt steps, relative to the diagonal of the matrix.
constexpr double kFirstDamping = 1e-3, kMinDamping = 1e-6, kMaxDamping = 1e4;

// Computes the deviation from the inverse of the matrix. A rotation w about the pivot and a shift of the
// pivot by `depth` times s move the camera centre by depth (w_y - s_x, -w_x - s_y, -s_z) in the camera's
// frame.
CameraDeviation deviation_of(const NormalEquations& at, double depth) {
  std::array<CameraMove, kPoseMoves> c{};  // the inverse
  for (std::size_t k = 0; k < kPoseMoves; ++k) {
    NormalEquations unit = at;
    unit.right = {};
    unit.right[k] = 1;
    c[k] = solve_normal(unit, kPoseMoves);
  }
  const double variance = at.squares / std::max(1.0, at.values - kPoseMoves);
  const double turn = c[0][0] + c[1][1] + c[2][2];
  const double centre = c[1][1] + c[3][3] - 2 * c[1][3] + c[0][0] + c[4][4] + 2 * c[0][4] + c[5][5];
  return {std::sqrt(variance * turn / 3), depth * std::sqrt(variance * centre / 3)};
}

}  // namespace

CameraMove solve_normal(NormalEquations e, std::size_t moves) {
  auto& m = e.matrix;
  for (std::size_t k = 0; k < moves; ++k)
    for (std::size_t i = k + 1; i < moves; ++i) {
      const double factor = m[i][k] / m[k][k];
      for (std::size_t j = k; j < moves; ++j) m[i][j] -= factor * m[k][j];
      e.right[i] -= factor * e.right[k];
    }
  CameraMove out{};
  for (std::size_t k = moves; k-- > 0;) {
    out[k] = e.right[k];
    for (std::size_t j = k + 1; j < moves; ++j) out[k] -= m[k][j] * out[j];
    out[k] /= m[k][k];
  }
  return out;
}

double limit_step(CameraMove& move) {
  double largest = 0;
  for (const double v : move) largest = std::max(largest, std::abs(v));
  for (double& v : move) v *= kMaxStep / std::max(largest, kMaxStep);
  return largest;
}

std::vector<Part> parts_of(const Split& split, std::span<const std::uint32_t> views,
                           std::span<const Camera> cameras) {
  std::vector<Part> parts;
  for (const std::uint32_t view : views) parts.push_back({split.views[view].load_image(), cameras[view]});
  return parts;
}

std::vector<Camera> cameras_of_parts(const Camera& first, std::span<const Part> parts) {
  std::vector<Camera> cameras{first};
  for (const Part& part : parts.subspan(1)) {
    const RotationMatrix turn = product(part.camera.rotation, transposed(parts[0].camera.rotation));
    cameras.push_back(part.camera);
    cameras.back().rotation = product(turn, first.rotation);
    cameras.back().translation = rotated(turn, first.translation);
  }
  return cameras;
}

PoseFit::PoseFit(const Drawing& drawing, std::span<const Part> parts, int factor, double depth)
    : drawing_(drawing), factor_(factor), depth_(depth) {
  for (const Part& part : parts) parts_.push_back({reduced(part.image, factor), part.camera});
}

void PoseFit::draw(std::span<const Camera> cameras) {
  std::vector<Camera> small;
  for (const Camera& camera : cameras)
    for (const Camera& part : cameras_of_parts(camera, parts_)) small.push_back(reduced(part, factor_));
  drawing_.renderer.set_cameras(small);
  renders_.assign(parts_.size(), {});
  for (std::uint32_t i = 0; i < small.size(); ++i) {
    drawing_.renderer.forward(drawing_.groups, i, drawing_.settings, false);
    std::vector<float> values = drawing_.renderer.download().rgb;
    // The values of a photograph are also between 0 and 1.
    for (float& value : values) value = std::clamp(value, 0.0f, 1.0f);
    renders_[i % parts_.size()].push_back(std::move(values));
  }
}

template <typename Visit>
void PoseFit::for_values(Visit visit) const {
  for (std::size_t part = 0; part < parts_.size(); ++part) {
    const Image8& image = parts_[part].image;
    for (std::size_t i = 0; i < image.rgb.size(); ++i)
      if (image.mask.empty() || image.mask[i / 3] != 0) visit(renders_[part], i, image.rgb[i] / 255.0);
  }
}

double PoseFit::squares(const Camera& camera) {
  draw({&camera, 1});
  double sum = 0;
  for_values([&](const auto& renders, std::size_t i, double truth) {
    const double residual = static_cast<double>(renders[0][i]) - truth;
    sum += residual * residual;
  });
  return sum;
}

NormalEquations PoseFit::linearise(const Camera& camera, std::size_t moves) {
  const double h = kStepPixels * factor_ / camera.fx;
  std::vector<Camera> cameras{camera};
  for (std::size_t k = 0; k < moves; ++k) {
    CameraMove move{};
    move[k] = h;
    cameras.push_back(moved(camera, move, depth_));
  }
  draw(cameras);
  NormalEquations out;
  for_values([&](const auto& renders, std::size_t i, double truth) {
    const double value = renders[0][i], residual = value - truth;
    CameraMove row{};
    for (std::size_t k = 0; k < moves; ++k) row[k] = (static_cast<double>(renders[k + 1][i]) - value) / h;
    for (std::size_t a = 0; a < moves; ++a) {
      out.right[a] -= row[a] * residual;
      for (std::size_t b = 0; b <= a; ++b) out.matrix[a][b] += row[a] * row[b];
    }
    out.squares += residual * residual;
    ++out.values;
  });
  for (std::size_t a = 0; a < moves; ++a)
    for (std::size_t b = 0; b < a; ++b) out.matrix[b][a] = out.matrix[a][b];
  return out;
}

// Compares all shifts of the pivot by whole pixels of the reduced image.
Camera PoseFit::search(const Camera& camera) {
  Camera best = camera;
  double least = squares(camera);
  for (int x = -kSearched; x <= kSearched; ++x)
    for (int y = -kSearched; y <= kSearched; ++y) {
      CameraMove move{};
      move[3] = x * factor_ / camera.fx, move[4] = y * factor_ / camera.fy;
      const Camera next = moved(camera, move, depth_);
      if (const double sum = squares(next); sum < least) least = sum, best = next;
    }
  return best;
}

Camera PoseFit::descend(Camera camera, int steps, const PoseHold& hold) {
  double damping = kFirstDamping;
  NormalEquations at = linearise(camera, kPoseMoves);
  for (int step = 0; step < steps && damping < kMaxDamping; ++step) {
    NormalEquations damped = at;
    double most = 0;
    for (std::size_t k = 0; k < kPoseMoves; ++k) most = std::max(most, at.matrix[k][k]);
    const double prior = hold.given ? hold.prior * most : 0;
    const auto back = [&](const Camera& from) {
      return prior > 0 ? pose_move(from, *hold.given, depth_) : CameraMove{};
    };
    const auto held = [&](const Camera& from) {
      const CameraMove move = back(from);
      return prior * std::inner_product(move.begin(), move.end(), move.begin(), 0.0);
    };
    const CameraMove way = back(camera);
    for (std::size_t k = 0; k < kPoseMoves; ++k) {
      damped.matrix[k][k] += damping * at.matrix[k][k] + hold.ridge * most + prior;
      damped.right[k] += prior * way[k];
    }
    CameraMove move = solve_normal(damped, kPoseMoves);
    for (double& v : move) v *= hold.stretch;
    if (!std::ranges::all_of(move, [](double v) { return std::isfinite(v); })) break;
    const double largest = limit_step(move);
    const Camera next = moved(camera, move, depth_);
    if (!(squares(next) + held(next) < at.squares + held(camera))) {
      damping *= 10;
      continue;
    }
    camera = next;
    if (largest < kSettledPixels * factor_ / camera.fx) break;
    damping = std::max(kMinDamping, damping / 10);
    if (step + 1 < steps) at = linearise(camera, kPoseMoves);
  }
  return camera;
}

FittedCamera fit_camera(const Drawing& drawing, std::span<const Part> parts, double depth, bool fits) {
  Camera camera = parts[0].camera;
  const auto short_side = [](const Part& part) { return std::min(part.camera.width, part.camera.height); };
  const int least = short_side(*std::ranges::min_element(parts, {}, short_side));
  bool searched = false;
  for (const int factor : {4, 2})
    if (fits && least / factor >= kMinShortSide) {
      PoseFit fit(drawing, parts, factor, depth);
      if (!searched) camera = fit.search(camera);
      searched = true;
      camera = fit.descend(camera, kFittingSteps);
    }
  PoseFit whole(drawing, parts, 1, depth);
  if (fits) camera = whole.descend(camera, kFittingSteps);
  return {camera, deviation_of(whole.linearise(camera, kPoseMoves), depth)};
}

}  // namespace ubs
