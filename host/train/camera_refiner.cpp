// SPDX-License-Identifier: Apache-2.0
#include "host/train/camera_refiner.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {
namespace {

constexpr std::size_t kPivotSplats = 4096;  // maximum number of splats that pivot_depth() uses
constexpr std::size_t kCameraNumbers = 17;  // numbers per view in the state
constexpr double kMostPixels = 2e5;         // maximum number of pixels of an image in a step
// The model has adapted to the current cameras, which makes the steps too short. They are therefore
// multiplied by this factor.
constexpr double kStretch = 1.3;
// Initial strength of a regularisation that shortens moves which hardly change the image. Early in the
// training, the model determines these moves poorly.
constexpr double kFirstRidge = 0.03;
// Weight of a prior that keeps cameras close to the given ones. Without it, cameras and model can drift
// together in directions that the images do not determine. Starting from correct poses, cameras drifted by
// 0.15 degrees in 20 sweeps (docs/results/2026-11-22-cameras.md).
constexpr double kPrior = 2e-3;
// Lenses are refined in the second half of the sweeps, because an early model fits any lens. Their prior is
// stronger than that of poses, and no number of the CameraMove from the given lens may exceed kMostLens.
// Without these limits, a few small images let the focal lengths grow without bound.
constexpr double kFirstLens = 0.5, kLensPrior = 0.02, kMostLens = 0.1;
constexpr double kLensDamping = 1e-2;  // relative increase of the diagonals in refine_lens()

bool same_lens(const Camera& a, const Camera& b) {
  return a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy && a.width == b.width &&
         a.height == b.height;
}

// Returns the change of the lens of `from` to that of `to`, as numbers 6 to 9 of a CameraMove.
CameraMove lens_move(const Camera& from, const Camera& to) {
  CameraMove move{};
  move[6] = std::log(to.fx / from.fx), move[7] = std::log(to.fy / from.fy);
  move[8] = (to.cx - from.cx) / from.fx, move[9] = (to.cy - from.cy) / from.fy;
  return move;
}

// Increases `count` diagonal entries: each by kLensDamping of its value, and by `share` of the largest one,
// which is returned.
double hold(NormalEquations& equations, std::size_t count, double share) {
  double most = 0;
  for (std::size_t k = 0; k < count; ++k) most = std::max(most, equations.matrix[k][k]);
  for (std::size_t k = 0; k < count; ++k)
    equations.matrix[k][k] += kLensDamping * equations.matrix[k][k] + share * most;
  return most;
}

}  // namespace

double pivot_depth(const Camera& camera, const SplatModel& model) {
  std::vector<double> depths;
  const int xyz = model.layout().xyz;
  const auto x = model.row(xyz), y = model.row(xyz + 1), z = model.row(xyz + 2);
  const std::array<double, 9>& r = camera.rotation;
  const std::array<double, 3>& t = camera.translation;
  for (std::size_t i = 0; i < model.count; i += model.count / kPivotSplats + 1) {
    Vec3 p{};
    for (std::size_t k = 0; k < 3; ++k)
      p[k] = r[3 * k] * x[i] + r[3 * k + 1] * y[i] + r[3 * k + 2] * z[i] + t[k];
    const double u = camera.fx * p[0] / p[2] + camera.cx, v = camera.fy * p[1] / p[2] + camera.cy;
    if (p[2] > 0 && u > 0 && v > 0 && u < camera.width && v < camera.height) depths.push_back(p[2]);
  }
  if (depths.empty()) return 1;
  std::ranges::nth_element(depths, depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2));
  return depths[depths.size() / 2];
}

CameraRefiner::CameraRefiner(const Split& train, const SplatModel& initial, RefineCameras what)
    : train_(train),
      what_(what),
      given_(cameras_of(train)),
      cameras_(given_),
      images_(views_by_image(train.views)) {
  for (std::size_t i = 0; i < given_.size(); ++i) {
    depth_.push_back(pivot_depth(given_[i], initial));
    std::size_t first = i;
    if (has_own_lens(i))
      for (first = 0; !has_own_lens(first) || !same_lens(given_[first], given_[i]);) ++first;
    lens_.push_back(first);
  }
}

Camera CameraRefiner::with_lens(const Camera& camera) const {
  Camera out = camera;
  for (std::size_t i = 0; i < given_.size(); ++i)
    if (has_own_lens(i) && same_lens(given_[i], camera)) {
      copy_intrinsics(out, cameras_[i]);
      break;
    }
  return out;
}

int CameraRefiner::factor_for(std::size_t view, int factor) const {
  const double pixels = static_cast<double>(given_[view].width) * given_[view].height;
  while (pixels / (factor * factor) > kMostPixels) ++factor;
  return factor;
}

// Refines one lens, and the poses of all views that share it, with one Gauss-Newton step. First the pose of
// each view is eliminated (Schur complement). The remaining equations contain only the lens. They take into
// account that every pose is adapted to a change of the lens. The step is only taken if it reduces the
// squared error of the images.
void CameraRefiner::refine_lens(const Drawing& drawing, int factor, std::size_t lens, double ridge) {
  constexpr std::size_t kLensMoves = kCameraMoves - kPoseMoves;
  std::map<std::uint32_t, NormalEquations> views;
  NormalEquations sum;
  const auto fit_of = [&](std::uint32_t view) {
    return PoseFit(drawing, parts_of(train_, {&view, 1}, cameras_), factor_for(view, factor), depth_[view]);
  };
  for (std::uint32_t i = 0; i < cameras_.size(); ++i) {
    if (lens_[i] != lens) continue;
    NormalEquations own = fit_of(i).linearise(cameras_[i], kCameraMoves);
    hold(own, kPoseMoves, ridge + kPrior);
    NormalEquations column = own;
    const CameraMove pose = solve_normal(column, kPoseMoves);
    // If the result is not finite, the image contains no information: all its pixels are masked, or it shows
    // no splat.
    if (!std::isfinite(pose[0])) continue;
    for (std::size_t b = kPoseMoves; b < kCameraMoves; ++b) {
      for (std::size_t k = 0; k < kPoseMoves; ++k) column.right[k] = own.matrix[k][b];
      const CameraMove answer = solve_normal(column, kPoseMoves);
      for (std::size_t a = kPoseMoves; a < kCameraMoves; ++a) {
        double given_way = 0;
        for (std::size_t k = 0; k < kPoseMoves; ++k) given_way += own.matrix[a][k] * answer[k];
        sum.matrix[a - kPoseMoves][b - kPoseMoves] += own.matrix[a][b] - given_way;
      }
      double given_way = 0;
      for (std::size_t k = 0; k < kPoseMoves; ++k) given_way += own.matrix[b][k] * pose[k];
      sum.right[b - kPoseMoves] += own.right[b] - given_way;
    }
    sum.squares += own.squares;
    views.emplace(i, own);
  }
  const double prior = kLensPrior * hold(sum, kLensMoves, ridge + kLensPrior);
  const auto held = [&](const Camera& camera) {
    const CameraMove way = lens_move(camera, given_[lens]);
    return prior * std::inner_product(way.begin(), way.end(), way.begin(), 0.0);
  };
  const CameraMove way = lens_move(cameras_[lens], given_[lens]);
  for (std::size_t k = 0; k < kLensMoves; ++k) sum.right[k] += prior * way[kPoseMoves + k];
  const CameraMove found = solve_normal(sum, kLensMoves);
  CameraMove change{};
  std::copy_n(found.begin(), kLensMoves, change.begin() + kPoseMoves);
  if (!std::ranges::all_of(change, [](double v) { return std::isfinite(v); })) return;
  limit_step(change);
  for (std::size_t k = kPoseMoves; k < kCameraMoves; ++k)
    change[k] = std::clamp(change[k], way[k] - kMostLens, way[k] + kMostLens);
  std::vector<Camera> next = cameras_;
  for (std::size_t i = 0; i < next.size(); ++i)
    if (lens_[i] == lens) copy_intrinsics(next[i], moved(cameras_[lens], change, depth_[lens]));
  double squares = held(next[lens]);
  for (auto& [view, own] : views) {
    for (std::size_t k = 0; k < kPoseMoves; ++k)
      for (std::size_t b = kPoseMoves; b < kCameraMoves; ++b) own.right[k] -= own.matrix[k][b] * change[b];
    CameraMove pose = solve_normal(own, kPoseMoves);
    limit_step(pose);
    next[view] = moved(next[view], pose, depth_[view]);
    squares += fit_of(view).squares(next[view]);
  }
  if (squares < sum.squares + held(cameras_[lens])) cameras_ = std::move(next);
}

void CameraRefiner::sweep(const Drawing& drawing, int factor, double done) {
  const double ridge = kFirstRidge * (1 - done) * (1 - done);
  if (what_ == RefineCameras::pose_and_intrinsics && done >= kFirstLens)
    for (std::size_t i = 0; i < cameras_.size(); ++i)
      if (lens_[i] == i && has_own_lens(i)) refine_lens(drawing, factor, i, ridge);
  for (const auto& views : images_) {
    const std::vector<Camera> cameras = refined(drawing, factor, views, ridge);
    for (std::size_t k = 0; k < views.size(); ++k) cameras_[views[k]] = cameras[k];
  }
  fix_similarity(cameras_, given_);
}

std::vector<Camera> CameraRefiner::refined(const Drawing& drawing, int factor,
                                           std::span<const std::uint32_t> views, double ridge) const {
  const std::uint32_t first = views[0];
  for (const std::uint32_t view : views) factor = std::max(factor, factor_for(view, factor));
  const std::vector<Part> parts = parts_of(train_, views, cameras_);
  PoseFit fit(drawing, parts, factor, depth_[first]);
  return cameras_of_parts(fit.descend(cameras_[first], 1, {ridge, kStretch, &given_[first], kPrior}), parts);
}

double CameraRefiner::sweep_seconds(const Drawing& drawing, int factor) const {
  refined(drawing, factor, images_[0], 0);  // warm-up: compiles the kernels and allocates the lists
  const Stopwatch watch;
  refined(drawing, factor, images_[0], 0);
  const double seconds_per_view = watch.seconds() / static_cast<double>(images_[0].size());
  // refined() renders a camera kPoseMoves + 2 times. refine_lens() renders it another kCameraMoves + 2 times.
  const double drawings = kPoseMoves + 2;
  const double more =
      what_ == RefineCameras::pose_and_intrinsics ? kFirstLens * (kCameraMoves + 2) / drawings : 0;
  return (1 + more) * seconds_per_view * static_cast<double>(cameras_.size());
}

std::vector<double> CameraRefiner::state() const {
  std::vector<double> out;
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    const Camera& c = cameras_[i];
    std::ranges::copy(c.rotation, std::back_inserter(out));
    std::ranges::copy(c.translation, std::back_inserter(out));
    for (const double v : {c.fx, c.fy, c.cx, c.cy, depth_[i]}) out.push_back(v);
  }
  return out;
}

void CameraRefiner::set_state(std::span<const double> state) {
  if (state.size() != cameras_.size() * kCameraNumbers)
    fail(ErrorKind::data, "the state has {} numbers of refined cameras, but {} views need {}", state.size(),
         cameras_.size(), cameras_.size() * kCameraNumbers);
  const double* from = state.data();
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    Camera& c = cameras_[i];
    for (double& v : c.rotation) v = *from++;
    for (double& v : c.translation) v = *from++;
    for (double* v : {&c.fx, &c.fy, &c.cx, &c.cy, &depth_[i]}) *v = *from++;
  }
}

}  // namespace ubs
