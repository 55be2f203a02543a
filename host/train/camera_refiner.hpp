// SPDX-License-Identifier: Apache-2.0
// The cameras of the training views as they are refined (method.md 4.10): now and then the model is held, and
// every camera takes a Gauss-Newton step to where the model looks more like its photograph.
#pragma once

#include <span>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/splat_model.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/fit_camera.hpp"

namespace ubs {

class CameraRefiner {
 public:
  // `initial` tells how far away things are, which decides the pivots. `train` must outlive the object.
  CameraRefiner(const Split& train, const SplatModel& initial, RefineCameras what);

  const std::vector<Camera>& cameras() const { return cameras_; }
  // With the lens as it is now, where a training view was given the same one: cameras of one lens share it.
  Camera with_lens(const Camera& camera) const;

  // A step of every camera on images reduced by `factor` or more, and then the gauge. `done`: the share of
  // the sweeps that came before.
  void sweep(const Drawing& drawing, int factor, double done);
  // Seconds that a sweep takes, by those of one camera, which stays as it is.
  double sweep_seconds(const Drawing& drawing, int factor) const;

  // Of each view: rotation, translation, fx, fy, cx, cy and the depth of its pivot.
  std::vector<double> state() const;
  void set_state(std::span<const double> state);

 private:
  Camera refined(const Drawing& drawing, int factor, std::size_t view, double ridge) const;
  void refine_lens(const Drawing& drawing, int factor, std::size_t lens);
  int factor_for(std::size_t view, int factor) const;

  const Split& train_;
  RefineCameras what_;
  std::vector<Camera> given_, cameras_;
  std::vector<double> depth_;
  std::vector<std::size_t> lens_;  // the first view with the same one
};

// The median depth of splats in the picture; of none, 1.
double pivot_depth(const Camera& camera, const SplatModel& model);

}  // namespace ubs
