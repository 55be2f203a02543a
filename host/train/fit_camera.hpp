// SPDX-License-Identifier: Apache-2.0
// fit_camera() finds the camera pose from which a fixed model looks most like a photograph, in squared error.
// It uses Gauss-Newton steps with finite differences of rendered images (method.md 4.10). The views of a wide
// image have one position and fixed angles between them, so one pose is fitted to all of them together.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/scene/camera_motion.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

// The renderer and the model with which the image of a camera is rendered.
struct Drawing {
  Renderer& renderer;  // its cameras are replaced
  std::span<const RenderGroup> groups;
  RenderSettings settings;
};

struct NormalEquations {  // matrix * move = right
  std::array<CameraMove, kCameraMoves> matrix{};
  CameraMove right{};
  double squares = 0, values = 0;  // sum of the squared residuals; number of residuals
};

// Solves the equations for the first `moves` moves and sets the others to 0. Returns NaN if the matrix is not
// definite.
CameraMove solve_normal(NormalEquations equations, std::size_t moves);

// Terms that limit the change of a pose, in addition to the comparison with its image.
struct PoseHold {
  // This share of the largest diagonal entry of J^T J is added to the diagonal. It reduces moves that
  // hardly change the image.
  double ridge = 0;
  double stretch = 1;  // factor by which steps are lengthened
  const Camera* given = nullptr;
  // Weight of the squared move to `given` in the squared error, as a share of the same entry.
  double prior = 0;
};

// Part is a pinhole view of a photograph. Most photographs have one.
struct Part {
  Image8 image;
  Camera camera;  // as given: its lens, and its rotation relative to the first part
};

// Returns the parts of an image, given its views and the present cameras of all views of the split.
std::vector<Part> parts_of(const Split& split, std::span<const std::uint32_t> views,
                           std::span<const Camera> cameras);

// Returns the cameras of all parts if the first part has the camera `first`.
std::vector<Camera> cameras_of_parts(const Camera& first, std::span<const Part> parts);

// PoseFit fits the pose of the first part of a photograph, given the model. The images are reduced by
// `factor`.
class PoseFit {
 public:
  // `depth` is the distance of the pivot from the camera.
  PoseFit(const Drawing& drawing, std::span<const Part> parts, int factor, double depth);

  // Returns the matrix J^T J and the right side -J^T r for the residuals r, with respect to the first `moves`
  // moves (6 or 10).
  NormalEquations linearise(const Camera& camera, std::size_t moves);
  // Compares this camera and the cameras whose image is shifted by up to three pixels, and returns the one
  // that fits best.
  Camera search(const Camera& camera);
  // Optimises the pose with at most `steps` Levenberg-Marquardt steps.
  Camera descend(Camera camera, int steps, const PoseHold& hold = {});

 private:
  double squares(const Camera& camera);
  // Renders every part from every camera of the first part.
  void draw(std::span<const Camera> cameras);
  // Calls visit(renders, i, truth) for all values i of the photograph that are not masked, where `renders`
  // are those of the part that contains the value.
  template <typename Visit>
  void for_values(Visit visit) const;

  Drawing drawing_;
  std::vector<Part> parts_;  // with reduced images
  int factor_;
  double depth_;
  std::vector<std::vector<std::vector<float>>> renders_;  // by part, then by camera
};

// Standard deviations of a pose, averaged over the axes: of rotations [rad] and of the centre [world units].
// They are computed from the inverse of J^T J times the mean squared residual. This assumes that the model is
// exact and that pixels are independent. Neither is true, so the values are lower bounds.
struct CameraDeviation {
  double turn = 0, centre = 0;
};

struct FittedCamera {
  Camera camera;
  CameraDeviation deviation;
};

// Fits the pose of the first part, starting from its camera, first on reduced images and then on the full
// images. If `fits` is false, it keeps the pose and only computes its deviation.
FittedCamera fit_camera(const Drawing& drawing, std::span<const Part> parts, double depth, bool fits = true);

}  // namespace ubs
