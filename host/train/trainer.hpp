// SPDX-License-Identifier: Apache-2.0
// Learns a splat model from the training views of a data set: the loop of method.md section 4 over the
// stages of a device. No state is hidden: the order of views, the noise and the sampling of relocation
// follow from (seed, iteration) alone, so a run is determined by settings, data, device and binary.
#pragma once

#include <array>
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
#include "host/train/guard.hpp"
#include "host/train/pyramid.hpp"
#include "host/train/target_images.hpp"
#include "host/train/timed_stages.hpp"
#include "host/train/train_state.hpp"
#include "host/train/view_order.hpp"

namespace ubs {

struct StepReport {
  int iteration = 0;   // 1-based
  double seconds = 0;  // training time so far, evaluations and start-up excluded
  std::uint32_t splats = 0;
  std::optional<double> loss;   // mean over the views since the last one; only on logged iterations
  std::optional<Metrics> test;  // only where an evaluation took place
};

// When the state of a run is handed out: every so many iterations, every so many seconds of training; 0:
// never.
struct StateSchedule {
  int iterations = 0;
  double seconds = 0;
  std::function<void(const TrainState&)> save;
};

// (tile, splat) pairs of the training views so far.
struct IntersectionCount {
  std::uint64_t most = 0, last = 0, total = 0, views = 0;
  std::uint64_t repeated = 0;  // steps that were drawn again, because a view had no room for its lists
  double mean() const { return views > 0 ? static_cast<double>(total) / static_cast<double>(views) : 0; }
};

class Trainer {
 public:
  // train must have images; test may be empty. All references must outlive the trainer.
  Trainer(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
          SplatModel initial);

  // Runs to the end. on_step is called after every iteration and may return false to stop.
  // An Error leaves the state of the last whole iteration where state_is_whole() says so; a value that is not
  // finite ends the run with Error(numerical), unless settings.on_nan says otherwise (docs/training.md).
  void run(const std::function<bool(const StepReport&)>& on_step);

  // The state after the last iteration. Waits.
  TrainState state() const;
  // Goes on from a state of a run with the same settings, data and device: with the same bits.
  void restore(const TrainState& state);
  bool state_is_whole() const { return whole_; }
  // The state is not handed out after the last iteration, nor while it holds a value that is not finite.
  void on_state(StateSchedule schedule) { schedule_ = std::move(schedule); }
  // Called for every value that is not finite, before training stops or goes on.
  void on_nonfinite(std::function<void(const NonFiniteEvent&)> report) {
    report_nonfinite_ = std::move(report);
  }

  SplatModel model() const { return model_.download(); }
  DeviceModel& device_model() { return model_; }
  Renderer& renderer() { return renderer_; }
  const RenderSettings& render_settings() const { return render_; }
  // Device memory of this run as counted beforehand, for the most intersections that a view has had so far.
  MemoryPlan memory_plan() const;
  double extent() const { return extent_; }
  int iteration() const { return iteration_; }
  double seconds() const { return seconds_; }
  int rollbacks() const { return rollbacks_; }
  std::uint64_t dropped() const { return dropped_; }  // splats
  const IntersectionCount& intersections() const { return intersections_; }
  // Where the training time of this process went, estimated from sampled iterations.
  std::vector<StageTime> stage_times() const { return stages_->times(); }
  // Of the model as it is now; with `more` also what that measures.
  Metrics evaluate_test(ImageMetrics* more = nullptr);

 private:
  void step();
  void set_cameras();
  void use_level_of(int iteration);
  // Forward and backward pass of the step's views; false when all of them are left out.
  int render_views();  // how many
  int render_views(bool uncounted, std::vector<UncountedView>& views);
  bool refine();  // true when splats moved or were added
  void update(int views);
  bool learns_at_once() const;  // the step in one pass with the end of its gradient
  Regularise penalty();
  AdamStep next_step();
  ImageLoss loss_of_draw(const Renderer& renderer, std::uint64_t draw, View1<float> sums);
  void update_appearance();
  void add_noise();
  int scaled(int iteration) const;  // a number of the 30 000-iteration schedule in this run's length
  bool regularised() const;
  bool refines_at(int iteration) const;
  bool refine_now() const { return refines_at(iteration_); }
  double cooldown() const;  // factor of all learning rates
  double lr_xyz() const;    // without it
  double lr_appearance() const;
  std::vector<float> learning_rates() const;  // of every parameter row
  std::size_t loss_rows() const;
  std::optional<double> read_loss(int iterations);  // mean over the last iterations; waits

  // trainer_guard.cpp
  bool look_due(bool reads_or_saves) const;
  bool look();  // true when all is finite; else has done what settings.on_nan says, and may have gone back
  void answer(NonFiniteEvent event, TrainState state);
  void inspect(const TrainState& state, NonFiniteEvent& event);
  void loss_not_finite(std::uint64_t draw);
  bool save_due() const;
  void save_state();

  Device& device_;
  TrainSettings settings_;
  const Split& train_;
  const Split& test_;
  double extent_;
  std::uint32_t frozen_;  // parameter groups
  bool uncounted_;        // the host does not wait for the size of the lists
  std::vector<PyramidLevel> levels_;
  int factor_ = 1;  // of the cameras and targets as they are now
  std::unique_ptr<TimedStages> stages_;
  DeviceModel model_;
  Renderer renderer_;
  RenderSettings render_;
  TargetImages targets_;
  ViewOrder order_, ahead_;  // the second one looks ahead across the end of an epoch
  Buffer<float> v_params_, moment1_, moment2_, learning_rates_, loss_sums_;
  Buffer<float> appearance_,
      v_appearance_;  // of all training images, of a batch; empty where it is not learnt
  int iteration_ = 0, logged_ = 0;
  std::uint64_t adam_steps_ = 0;
  double seconds_ = 0;
  IntersectionCount intersections_;

  static constexpr std::size_t kLookEvery = 16;  // iterations between looks at the sentinel, at most
  OnNan on_nan_;
  Buffer<std::uint32_t> sentinel_;  // (1): iteration of the first value that is not finite; 0: none
  int looked_ = 0;                  // iteration of the last look
  std::array<std::uint64_t, kLookEvery + 1> adam_history_{};  // adam_steps_ by iteration modulo its size
  std::optional<TrainState> good_;                            // where a rollback goes
  std::set<std::uint64_t> skipped_draws_;
  int rollbacks_ = 0;
  std::uint64_t dropped_ = 0;
  bool whole_ = true, left_out_ = false;
  double saved_seconds_ = 0;
  StateSchedule schedule_;
  std::function<void(const NonFiniteEvent&)> report_nonfinite_;
};

}  // namespace ubs
