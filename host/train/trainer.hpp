// SPDX-License-Identifier: Apache-2.0
// Learns a splat model from the training views of a data set: the loop of method.md section 4 over the
// stages of a device. No state is hidden: the order of views, the noise and the sampling of relocation
// follow from (seed, iteration) alone, so a run is determined by settings, data, device and binary.
// What happens when says Schedule, on what TrainingViews, and what when a value is not finite Guard.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "host/base/time_source.hpp"
#include "host/cluster/communicator.hpp"
#include "host/cluster/deal.hpp"
#include "host/device/operations.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/pipeline/shared_renderer.hpp"
#include "host/scene/dataset.hpp"
#include "host/spec/train_settings.hpp"
#include "host/train/evaluate.hpp"
#include "host/train/fit_camera.hpp"
#include "host/train/guard.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/schedule.hpp"
#include "host/train/shared_splats.hpp"
#include "host/train/time_budget.hpp"
#include "host/train/timed_stages.hpp"
#include "host/train/train_state.hpp"
#include "host/train/training_views.hpp"

namespace ubs {

struct StepReport {
  int iteration = 0;        // 1-based
  int iterations = 0;       // of the run; with a time budget, as many as there is time for now
  double share = 0;         // of the work, that is done
  double seconds = 0;       // training time so far, evaluations and start-up excluded
  double seconds_left = 0;  // of training, as it looks now; known with a time budget only, else 0
  std::uint32_t splats = 0;
  std::optional<double> loss;   // mean over the views since the last one; only on logged iterations
  std::optional<Metrics> test;  // only where an evaluation took place
};

// When the state of a run is handed out: every so many iterations, every so many seconds of training; 0:
// never.
struct StateSaving {
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
  // train must have images; test may be empty. All references must outlive the trainer. Several ranks share
  // splats and views, with the bits of one (docs/cluster.md): all make the same trainer and call the same of
  // what is marked "all ranks"; on_step of the first one decides.
  // `time` measures the training time, which decides about evaluations and checkpoints by seconds.
  Trainer(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
          SplatModel initial, Communicator& ranks = alone(), const TimeSource& time = steady_time());

  // Runs to the end. on_step is called after every iteration and may return false to stop.
  // An Error leaves the state of the last whole iteration where state_is_whole() says so; a value that is not
  // finite ends the run with Error(numerical), unless settings.on_nan says otherwise (docs/training.md).
  void run(const std::function<bool(const StepReport&)>& on_step);

  // The run keeps to a time budget, which the settings were chosen for (choose_iterations): iterations,
  // work_shares and growth_end of settings() follow the clock. Before the first iteration, or before the run
  // of a restored state. One process.
  void keep_to(const TimeBudget& budget);
  // The settings of the run, automatic ones resolved.
  const TrainSettings& settings() const { return settings_; }

  // The state after the last iteration. Waits. All ranks; each gets its part of the splats, or with
  // `everywhere` all of them.
  TrainState state(bool everywhere = false) const;
  // Goes on from a state of a run with the same settings, data and device: with the same bits. All ranks,
  // with the same state; the run that it is from may have had any number of them.
  void restore(const TrainState& state);
  // Returns the seconds that a step of all cameras takes on images reduced by `factor`, where cameras are
  // refined. They stay as they are.
  double sweep_seconds(int factor);
  bool state_is_whole() const { return whole_; }
  // The state is not handed out after the last iteration, nor while it holds a value that is not finite.
  void on_state(StateSaving saving) { saving_ = std::move(saving); }
  // Called with a message for every value that is not finite after which training goes on.
  void on_nonfinite(std::function<void(const std::string&)> report) { guard_.on_event(std::move(report)); }

  SplatModel model() const;                       // all ranks; the first one gets it
  DeviceModel& device_model() { return model_; }  // of this rank
  std::uint32_t splats() const { return sharing_ ? sharing_->splats.total() : model_.count(); }
  // Of several ranks, before the first step: how many views of a batch each one draws, in place of as many.
  void deal_views(std::vector<std::uint64_t> by_rank) { sharing_->deal = Deal(std::move(by_rank)); }
  const Deal* deal() const { return sharing_ ? &sharing_->deal : nullptr; }  // null: one process
  // The picture of a training view as each rank draws it on its device: the largest difference from the first
  // rank's [of white]. All ranks.
  std::vector<double> picture_differences(std::uint32_t view);
  // Draws a view of these cameras into renderer() of the first rank. All ranks.
  void set_cameras(const std::vector<Camera>& cameras);
  void draw(std::uint32_t camera);
  Communicator& ranks() const { return ranks_; }
  std::uint64_t bytes_sent() const { return sharing_ ? sharing_->views.bytes_sent() : 0; }  // of this rank
  Renderer& renderer() { return renderer_; }
  RenderSettings render_settings() const { return ubs::render_settings(settings_); }
  // The settings with the background that has been learnt so far: how the model is drawn elsewhere.
  TrainSettings drawn_settings() const;
  // Device memory of this run as counted beforehand, for the most intersections that a view has had so far.
  MemoryPlan memory_plan() const;
  double extent() const { return schedule_.extent(); }
  int iteration() const { return progress_.iteration; }
  double seconds() const { return progress_.seconds; }
  int rollbacks() const { return progress_.rollbacks; }
  std::uint64_t dropped() const { return progress_.dropped; }  // splats
  const IntersectionCount& intersections() const { return intersections_; }
  // Where the training time of this process went, estimated from sampled iterations.
  std::vector<StageTime> stage_times() const { return stages_->times(); }
  // Of the model as it is now; with `more` also what that measures. All ranks.
  Metrics evaluate_test(ImageMetrics* more = nullptr);
  bool refines_cameras() const { return views_.refiner() != nullptr; }
  const std::vector<Camera>& train_cameras() const { return views_.refiner()->cameras(); }  // refined so far
  std::vector<Camera> test_cameras() const { return views_.test_cameras(); }  // as they are measured from
  // After the last iteration of a run that refines cameras: those of the test views, fitted to the model, and
  // those of the training views as they were learnt, with their deviations.
  const std::vector<FittedCamera>& held_out_cameras();
  std::vector<FittedCamera> refined_cameras();

 private:
  struct LearnBuffers {  // gradients and moments of what is learnt, rates of all rows, loss sums by draw
    Buffer<float> v_params, moment1, moment2, rates, loss_sums;
    Buffer<float> v_sky;  // (batch, 27), or none: the background is not learnt
  };

  struct Sharing {
    SharedRenderer views;
    SharedSplats splats;
    Deal deal;  // of the views of a batch
  };

  void step();
  void use_level_of(int iteration);
  // Forward and backward pass of the step's views; how many were not left out.
  int render_views();
  int render_views(bool uncounted, std::vector<UncountedView>& views);
  int render_shared_views();
  void draw_shared(std::vector<std::int64_t> cameras);
  void count(std::uint64_t intersections);
  std::uint64_t last_draw() const;
  void loss_of(std::uint64_t draw);
  void upload_first_view(int iteration);
  std::vector<float> sky_state() const;  // empty: not learnt
  void learn_sky();
  void merge_by_draw(BufferView<float> rows, std::size_t width) const;
  std::vector<float> loss_sums() const;
  void agree(bool& by_time, bool& saves);
  std::uint32_t relocate();
  void grow(std::uint32_t target);
  bool refine();  // true when splats moved or were added
  void update(int views);
  bool refines_now() const { return schedule_.refines(progress_.iteration); }
  bool learns_at_once() const { return !refines_now(); }  // the step in one pass with the end of its gradient
  Regularise penalty();
  AdamStep next_step();
  void add_noise();
  std::vector<float> rates() const;
  std::size_t loss_rows() const;
  std::optional<double> read_loss(int iterations);  // mean over the last iterations; waits
  double loss_of_draw(const std::vector<float>& sums, std::uint64_t draw) const;

  void sweep_cameras(double done);
  void measure_fitted(Metrics& metrics);
  std::vector<FittedCamera> fit_cameras(const Split& split, std::size_t first, bool fits);
  bool look();  // true when all is finite; else has done what settings.on_nan says, and may have gone back
  void loss_not_finite(std::uint64_t draw);
  void answer(const NonFiniteEvent& event, TrainState state);
  bool at_point() const;  // where a time budget sets the speed of the run
  void set_pace();
  bool save_due() const;
  void save_state();

  const TimeSource& time_;
  Communicator& ranks_;
  Device& device_;
  TrainSettings settings_;
  const std::uint32_t initial_;  // splats at the start
  TrainingViews views_;
  Schedule schedule_;
  std::unique_ptr<TimedStages> stages_;
  DeviceModel model_;
  Renderer renderer_;
  LearnBuffers learning_;
  std::unique_ptr<Sharing> sharing_;  // of several ranks
  TrainProgress progress_;
  IntersectionCount intersections_;
  Guard guard_;
  std::optional<BudgetPace> pace_;  // of a run with a time budget
  double swept_ = 0;                // seconds of camera sweeps
  bool whole_ = true;
  std::vector<FittedCamera> held_out_;  // once they have been fitted
  StateSaving saving_;
  double saved_seconds_ = 0;
};

}  // namespace ubs
