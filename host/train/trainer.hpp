// SPDX-License-Identifier: Apache-2.0
// Learns a splat model from the training views of a data set: the loop of method.md section 4 over the
// stages of a device. No state is hidden: the order of views, the noise and the sampling of relocation
// follow from (seed, iteration) alone, so a run is determined by settings, data, device and binary.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "host/device/registry.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/dataset.hpp"
#include "host/spec/train_settings.hpp"
#include "host/train/evaluate.hpp"
#include "host/train/target_images.hpp"
#include "host/train/view_order.hpp"

namespace ubs {

struct StepReport {
  int iteration = 0;            // 1-based
  double seconds = 0;           // training time so far, evaluations and start-up excluded
  std::uint32_t splats = 0;
  std::optional<double> loss;   // mean over the views since the last one; only on logged iterations
  std::optional<Metrics> test;  // only where an evaluation took place
};

class Trainer {
 public:
  // train must have images; test may be empty. All references must outlive the trainer.
  Trainer(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
          SplatModel initial);

  // Runs to the end. on_step is called after every iteration and may return false to stop.
  void run(const std::function<bool(const StepReport&)>& on_step);

  SplatModel model() const { return model_.download(); }
  DeviceModel& device_model() { return model_; }
  Renderer& renderer() { return renderer_; }
  const RenderSettings& render_settings() const { return render_; }
  // Device memory of this run as counted beforehand, for the most intersections that a view has had so far.
  MemoryPlan memory_plan() const;
  double extent() const { return extent_; }
  int iteration() const { return iteration_; }
  double seconds() const { return seconds_; }

 private:
  void step();
  bool refine();  // true when splats moved or were added
  void update();
  void add_noise();
  Metrics evaluate_test();
  int scaled(int iteration) const;  // a number of the 30 000-iteration schedule in this run's length
  bool regularised() const;
  bool refine_now() const;
  double lr_xyz() const;
  std::vector<float> learning_rates() const;  // of every parameter row
  std::size_t loss_rows() const;
  double read_loss(int iterations) const;     // mean over the last iterations; waits

  Device& device_;
  TrainSettings settings_;
  const Split& train_;
  const Split& test_;
  double extent_;
  std::uint32_t frozen_;  // parameter groups
  std::unique_ptr<Stages> stages_;
  DeviceModel model_;
  Renderer renderer_;
  RenderSettings render_;
  TargetImages targets_;
  ViewOrder order_, ahead_;  // the second one looks ahead across the end of an epoch
  Buffer<float> v_params_, moment1_, moment2_, learning_rates_, loss_sums_;
  int iteration_ = 0;
  std::uint64_t adam_steps_ = 0;
  double seconds_ = 0;
};

}  // namespace ubs
