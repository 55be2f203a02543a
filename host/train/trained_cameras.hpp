// SPDX-License-Identifier: Apache-2.0
// TrainedCameras is the part of a training that refines cameras (method.md 4.10): it sweeps over those of the
// training views, and in the end fits those of the test views. All of it holds the model, and none of it is
// for several ranks.
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
  // One step of every camera. `done`: the share of the sweeps that came before.
  void sweep(double done);
  double swept_seconds() const { return swept_; }  // in all sweeps so far
  // Returns the seconds that a sweep takes on images reduced by `factor`. The cameras stay as they are.
  double sweep_seconds(int factor);

  const std::vector<Camera>& train() const { return views_.refiner()->cameras(); }  // refined so far
  std::vector<Camera> test() const { return views_.test_cameras(); }  // as they are measured from
  // The cameras of the test views, fitted to the model as it is at the first call after forget(); and those
  // of the training views as they were learnt, with their deviations.
  const std::vector<FittedCamera>& held_out();
  std::vector<FittedCamera> learnt() { return fit(views_.train(), 0, false); }
  void forget() { held_out_.clear(); }
  // Measures the test views from the fitted cameras, into ViewMetrics::posed.
  void measure_fitted(Metrics& metrics);

 private:
  std::vector<FittedCamera> fit(const Split& split, std::size_t first, bool fits);
  // The splats as they are drawn. None of this is time of a training's stages.
  RenderGroup group() {
    stages_.pause();
    return {&stages_, splats_.view()};
  }
  // What draws leaves other cameras in the renderer than training wants.
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
