// SPDX-License-Identifier: Apache-2.0
// CameraRefiner holds the cameras of the training views and refines them during training (method.md 4.10). At
// a few points of the run the model is kept fixed, and each camera takes one Gauss-Newton step that makes the
// rendered image more similar to its photograph.
#pragma once

#include <span>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/splat_model.hpp"
#include "host/train/fit_camera.hpp"

namespace ubs {

enum class RefineCameras;  // train_settings.hpp

class CameraRefiner {
 public:
  // Computes the depth of each camera's pivot (camera_motion.hpp) from the splats of `initial`. `what`
  // selects whether only poses or also lenses are refined. `train` must outlive the object.
  CameraRefiner(const Split& train, const SplatModel& initial, RefineCameras what);

  const std::vector<Camera>& cameras() const { return cameras_; }
  // Returns `camera` with the refined lens (focal lengths and principal point) if a training view had the
  // same lens before the refinement. Training views that had the same lens before still have the same lens
  // afterwards.
  Camera with_lens(const Camera& camera) const;

  // Takes one step of every camera, on images that are reduced by `factor` or more, and then calls
  // fix_similarity(). The views of a wide image keep a common position and the given angles between them.
  // Their lens is not refined, because it is not the lens of the photograph. `done` is the share of all
  // sweeps that have already taken place.
  void sweep(const Drawing& drawing, int factor, double done);
  // Returns the estimated time of a sweep in seconds. The function measures the step for the first image,
  // without changing its cameras, and derives the time of all cameras from it.
  double sweep_seconds(const Drawing& drawing, int factor) const;

  // Returns 17 numbers per view: rotation, translation, fx, fy, cx, cy and the depth of the pivot.
  std::vector<double> state() const;
  void set_state(std::span<const double> state);

 private:
  // Returns the refined cameras of the views of an image.
  std::vector<Camera> refined(const Drawing& drawing, int factor, std::span<const std::uint32_t> views,
                              double ridge) const;
  void refine_lens(const Drawing& drawing, int factor, std::size_t lens, double ridge);
  int factor_for(std::size_t view, int factor) const;
  bool has_own_lens(std::size_t view) const { return train_.views[view].part_of.empty(); }

  const Split& train_;
  RefineCameras what_;
  std::vector<Camera> given_, cameras_;
  std::vector<std::vector<std::uint32_t>> images_;  // the views of each image
  std::vector<double> depth_;
  // For each view, the first view that had the same lens in the data; for a view of a wide image, the view
  // itself.
  std::vector<std::size_t> lens_;
};

// Returns the median depth of the splats in the image of the camera, or 1 if there are none.
double pivot_depth(const Camera& camera, const SplatModel& model);

}  // namespace ubs
