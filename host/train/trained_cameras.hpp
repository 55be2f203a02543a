// SPDX-License-Identifier: Apache-2.0
// TrainedCameras refines the cameras during training (method.md 4.10). In several sweeps, it refines the
// cameras of the training views. At the end, it fits the camera poses of the test views to the model. The
// model does not change while cameras are refined. Several ranks are not supported.
#pragma once

#include <vector>

#include "host/base/time_source.hpp"
#include "host/train/timed_stages.hpp"
#include "host/train/view_passes.hpp"

namespace ubs {

class TrainedCameras {
 public:
  TrainedCameras(Device& device, TimedStages& stages, TrainingViews& views, ViewPasses& passes,
                 TrainedSplats& splats, const TimeSource& time)
      : device_(device), stages_(stages), views_(views), passes_(passes), splats_(splats), time_(time) {}

  bool refines() const { return views_.refiner() != nullptr; }
  // Performs a sweep: one refinement step of every camera. `done` increases from 0 for the first sweep to 1
  // for the last (Schedule::camera_sweep).
  void sweep(double done);
  double swept_seconds() const { return swept_; }  // seconds of all sweeps so far
  // Returns the estimated seconds of a sweep on images reduced by `factor`. The cameras are not changed.
  double sweep_seconds(int factor);

  // Returns the cameras of the training views, as refined so far.
  const std::vector<Camera>& train() const { return views_.refiner()->cameras(); }
  // Returns the cameras with which the test views are evaluated.
  std::vector<Camera> test() const { return views_.test_cameras(); }
  // held_out() returns the cameras of the test views, fitted to the model. They are computed at the first
  // call, and again at the first call after forget(). learnt() returns the refined cameras of the training
  // views, with their standard deviations.
  const std::vector<FittedCamera>& held_out();
  std::vector<FittedCamera> learnt() { return fit(views_.train(), 0, false); }
  void forget() { held_out_.clear(); }
  // Measures the test views from the fitted cameras and stores the results in ViewMetrics::posed.
  void measure_fitted(Metrics& metrics);

 private:
  std::vector<FittedCamera> fit(const Split& split, std::size_t first, bool fits);
  // Returns the splats for rendering. Pauses the stage timers, because refining cameras is not counted as
  // time of the training stages.
  RenderGroup group() {
    stages_.pause();
    return {&stages_, splats_.view()};
  }
  // Gives the renderer the cameras of the training views again, after it has used other cameras.
  void restore_cameras() { passes_.set_cameras(views_.cameras()); }

  Device& device_;
  TimedStages& stages_;
  TrainingViews& views_;
  ViewPasses& passes_;
  TrainedSplats& splats_;
  const TimeSource& time_;
  double swept_ = 0;
  std::vector<FittedCamera> held_out_;
};

}  // namespace ubs
