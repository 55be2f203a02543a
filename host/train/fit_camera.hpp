// SPDX-License-Identifier: Apache-2.0
// The pose from which a fixed model looks most like a photograph, in squared error: Gauss-Newton with
// differences of drawn images (method.md 4.10).
#pragma once

#include <array>
#include <span>

#include "host/pipeline/renderer.hpp"
#include "host/scene/camera_motion.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

// What a camera is compared through.
struct Drawing {
  Renderer& renderer;  // whose cameras are replaced
  std::span<const RenderGroup> groups;
  RenderSettings settings;
};

struct NormalEquations {  // matrix * move = right
  std::array<CameraMove, kCameraMoves> matrix{};
  CameraMove right{};
  double squares = 0, values = 0;  // residuals: the sum of their squares, how many
};

// With the first `moves` moves; the others are 0. NaN where the matrix is not definite.
CameraMove solve_normal(NormalEquations equations, std::size_t moves);

// What keeps a pose, beside its image.
struct PoseHold {
  double ridge =
      0;  // this share of the largest diagonal entry of J^T J holds back what the image hardly shows
  double stretch = 1;  // steps are made longer by it
  const Camera* given = nullptr;
  double prior = 0;  // and this share times the squared move to `given` is added to the squared error
};

// A photograph, reduced by `factor`, and the model.
class PoseFit {
 public:
  // `depth`: of the pivot.
  PoseFit(const Drawing& drawing, const Image8& photograph, int factor, double depth);

  // The matrix J^T J and -J^T r of the residuals r, with the first `moves` moves (6 or 10).
  NormalEquations linearise(const Camera& camera, std::size_t moves);
  // Of this camera and those from which the image is shifted by up to three pixels, the one that fits best.
  Camera search(const Camera& camera);
  // Levenberg-Marquardt in the pose, at most `steps` steps.
  Camera descend(Camera camera, int steps, const PoseHold& hold = {});

 private:
  double squares(const Camera& camera);
  void draw(std::span<const Camera> cameras);
  template <typename Visit>
  void for_values(Visit visit) const;

  Drawing drawing_;
  Image8 photograph_;
  int factor_;
  double depth_;
  std::vector<std::vector<float>> images_;
};

// Deviations of a pose, as means over the axes: of turns [rad] and of the centre [world units]. From the
// inverse of J^T J times the mean squared residual: the model is taken as true and pixels as independent,
// which they are not, so these are lower bounds.
struct CameraDeviation {
  double turn = 0, centre = 0;
};

struct FittedCamera {
  Camera camera;
  CameraDeviation deviation;
};

// From reduced images to the whole one. `fits`: false leaves the pose as it is and finds its deviation alone.
FittedCamera fit_camera(const Drawing& drawing, const Image8& photograph, const Camera& start, double depth,
                        bool fits = true);

}  // namespace ubs
