// SPDX-License-Identifier: Apache-2.0
// fit_camera() finds the camera pose for which the render of a fixed model has the smallest squared
// difference from a photograph. It uses damped Gauss-Newton steps (Levenberg-Marquardt) with finite
// differences of rendered images (method.md 4.10). The views of a wide image have one position and fixed
// angles between them, so one pose is fitted to all of them together.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/scene/camera_motion.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

// Drawing holds the renderer and the model that are used to render images.
struct Drawing {
  Renderer& renderer;  // its cameras are replaced
  std::span<const RenderGroup> groups;
  RenderSettings settings;
};

// NormalEquations are the linear equations matrix * move = right for a CameraMove.
struct NormalEquations {
  std::array<CameraMove, kCameraMoves> matrix{};
  CameraMove right{};
  double squares = 0, values = 0;  // sum of the squared residuals; number of residuals
};

// Solves the equations for the first `moves` numbers of the move and sets the others to 0. The result
// contains NaN or infinite values if the matrix is singular.
CameraMove solve_normal(NormalEquations equations, std::size_t moves);

// Shortens a move whose largest number is above 0.03, and returns the largest number before. Longer steps
// diverge while the model is nearly transparent.
double limit_step(CameraMove& move);

// PoseHold changes the steps of PoseFit::descend(): `ridge` and `prior` limit them, and `stretch` lengthens
// them. With the default values, nothing is changed.
struct PoseHold {
  // The largest diagonal entry of J^T J, multiplied by `ridge`, is added to the diagonal. This shortens moves
  // that hardly change the image.
  double ridge = 0;
  double stretch = 1;  // factor by which each step is multiplied
  const Camera* given = nullptr;
  // If `given` is not null, the squared length of the move from the pose to `given` is added to the squared
  // error. Its weight is `prior` times the largest diagonal entry of J^T J.
  double prior = 0;
};

// Part is a pinhole view of a photograph. A wide image has several parts, and other photographs have one.
struct Part {
  Image8 image;
  Camera camera;  // defines the lens, and the rotation relative to the first part
};

// Returns the parts of an image. `views` are the indices of its views, and `cameras` are the current cameras
// of all views of the split.
std::vector<Part> parts_of(const Split& split, std::span<const std::uint32_t> views,
                           std::span<const Camera> cameras);

// Returns the cameras of all parts if the first part has the camera `first`.
std::vector<Camera> cameras_of_parts(const Camera& first, std::span<const Part> parts);

// PoseFit fits the pose of the first part of a photograph to a fixed model. It uses images that are reduced
// by `factor`.
class PoseFit {
 public:
  // `depth` is the distance of the pivot of the moves (host/scene/camera_motion.hpp) from the camera.
  PoseFit(const Drawing& drawing, std::span<const Part> parts, int factor, double depth);

  // Returns the matrix J^T J and the right side -J^T r for the residuals r, where J is the derivative of r
  // with respect to the first `moves` numbers of a CameraMove (6 or 10).
  NormalEquations linearise(const Camera& camera, std::size_t moves);
  // Returns the sum of the squared residuals.
  double squares(const Camera& camera);
  // Compares this camera with cameras that are moved so that the reduced image is shifted by up to three
  // pixels. Returns the camera whose render is most similar to the photograph.
  Camera search(const Camera& camera);
  // Optimises the pose with at most `steps` Levenberg-Marquardt steps.
  Camera descend(Camera camera, int steps, const PoseHold& hold = {});

 private:
  // Renders every part from every camera of the first part.
  void draw(std::span<const Camera> cameras);
  // Calls visit(renders, i, truth) for each value of the photograph that is not masked. `truth` is the value,
  // `i` is its index in its part, and `renders` are the renders of this part.
  template <typename Visit>
  void for_values(Visit visit) const;

  Drawing drawing_;
  std::vector<Part> parts_;  // with reduced images
  int factor_;
  double depth_;
  std::vector<std::vector<std::vector<float>>> renders_;  // by part, then by camera
};

// CameraDeviation holds the standard deviations of a pose, averaged over the axes: the deviation of the
// rotation [rad] and that of the camera centre [world units]. They are computed from the inverse of J^T J
// times the mean squared residual. This assumes that the model is exact and that pixels are independent. Both
// assumptions are too optimistic, so the values are lower bounds.
struct CameraDeviation {
  double turn = 0, centre = 0;
};

struct FittedCamera {
  Camera camera;
  CameraDeviation deviation;
};

// Fits the pose of the first part, starting from its camera, first on reduced images, if they are not too
// small, and then on the full images. If `fits` is false, the function keeps the pose and only computes its
// deviation.
FittedCamera fit_camera(const Drawing& drawing, std::span<const Part> parts, double depth, bool fits = true);

}  // namespace ubs
