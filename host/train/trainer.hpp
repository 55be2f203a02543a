// SPDX-License-Identifier: Apache-2.0
// Trainer optimises a splat model on the training views of a data set. It runs the training loop of
// method.md, section 4, on one device, or on several MPI ranks that share the splats and the views
// (docs/cluster.md).
// It consists of several parts. Schedule decides at which iteration what happens, TrainingViews supplies
// cameras and photographs, ViewPasses renders them, TrainedSplats holds the optimised parameters, Guard
// handles values that are not finite, and BudgetPace keeps the run within a time budget.
// Training is reproducible: all random choices (order of views, noise, sampling for relocation) depend only
// on the seed and the iteration, and there is no hidden state. With the same settings, data, device and
// build, two runs give bit-identical models, also after a restore().
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "host/base/time_source.hpp"
#include "host/cluster/communicator.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/guard.hpp"
#include "host/train/learnt_sky.hpp"
#include "host/train/loss_log.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/schedule.hpp"
#include "host/train/shared_view_passes.hpp"
#include "host/train/test_sample.hpp"
#include "host/train/time_budget.hpp"
#include "host/train/timed_stages.hpp"
#include "host/train/trained_cameras.hpp"
#include "host/train/training_views.hpp"

namespace ubs {

struct StepReport {
  int iteration = 0;        // 1-based
  int iterations = 0;       // of the run; with a time budget, the present estimate
  double share = 0;         // share of the work that is done
  double seconds = 0;       // training time so far, without evaluations and start-up
  double seconds_left = 0;  // estimated training time that is left; 0 without a time budget
  std::uint32_t splats = 0;
  // Mean over the views since the last logged iteration; only on logged iterations.
  std::optional<double> loss;
  std::optional<Metrics> test;        // only after an evaluation
  std::optional<SampledPsnr> sample;  // only after a measurement of a few test views
};

// `save` is called with the state of the run every `iterations` iterations and every `seconds` seconds of
// training; 0: never.
struct StateSaving {
  int iterations = 0;
  double seconds = 0;
  std::function<void(const TrainState&)> save;
};

class Trainer {
 public:
  // `train` must have images; `test` may be empty. All references must outlive the trainer.
  // Several ranks share splats and views, and results are bit-identical to those of one process
  // (docs/cluster.md). All ranks must construct the same trainer, call run(), and make the same calls of the
  // other methods whose comments say that all ranks must call them. If the on_step() of any rank returns
  // false, all ranks stop.
  // `time` measures the training time, on which evaluations and checkpoints at intervals of seconds depend.
  Trainer(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
          SplatModel initial, Communicator& ranks = alone(), const TimeSource& time = steady_time());

  // Trains to the end. on_step is called after every iteration and may return false to stop. If an Error is
  // thrown and state_is_whole() returns true, the state is that of the last completed iteration. A value that
  // is not finite ends the run with Error(numerical), unless settings.on_nan requests otherwise
  // (docs/training.md).
  void run(const std::function<bool(const StepReport&)>& on_step);

  // Lets the run keep to a time budget, for which the settings must have been chosen (choose_iterations). The
  // members iterations, work_shares and growth_end of settings() then change during the run. Must be called
  // before the first iteration, or before run() continues a restored state. Only for one process.
  void keep_to(const TimeBudget& budget);
  // Lets the run measure a few test views in between, if this takes little time (TestSample). The model does
  // not depend on it. Must be called before run(); has no effect with several ranks.
  void sample_test() { samples_ = true; }
  // Lets a run with a time budget end early: within about `seconds`, it does the last part of its schedule,
  // in which the learning rates fall to 0 (BudgetPace::complete). This begins after the next iteration,
  // unless that is the last one. The state at this point is saved (on_state), and later ones are not, so that
  // the run can also be resumed as if it had not been ended. Must be called by on_step().
  void complete_in(double seconds);
  // Continues a finished run with a time budget for about `seconds`: it repeats the last part of its schedule
  // with the present splats. Must be called after keep_to() and before run().
  void go_on_for(double seconds);
  // Returns the progress at which complete_in() took effect.
  const std::optional<TrainProgress>& completed_from() const { return completed_from_; }
  // Returns the settings of the run, in which automatic values are resolved.
  const TrainSettings& settings() const { return schedule_.settings(); }
  // Returns the settings with the background that has been learnt so far. Use them to render the model
  // outside of the trainer.
  TrainSettings drawn_settings() const;
  RenderSettings render_settings() const { return passes_->settings(); }

  // Waits for the device and returns the state after the last iteration. All ranks must call it. Each rank
  // gets its part of the splats, or with `everywhere` all splats.
  TrainState state(bool everywhere = false) const;
  // Continues from a state of a run with the same settings, data and device; the results are bit-identical to
  // those of an uninterrupted run. All ranks must call it with the same state. The run that saved it may have
  // had any number of ranks.
  void restore(const TrainState& state);
  bool state_is_whole() const { return whole_; }
  // Sets when states are saved. The state is not saved after the last iteration, nor while it contains a
  // value that is not finite.
  void on_state(StateSaving saving) { saving_ = std::move(saving); }
  // `report` is called with a message for every value that is not finite after which training continues.
  void on_nonfinite(std::function<void(const std::string&)> report) { guard_.on_event(std::move(report)); }

  // Progress of the run.
  int iteration() const { return progress_.iteration; }
  double seconds() const { return progress_.seconds; }
  int rollbacks() const { return progress_.rollbacks; }
  std::uint64_t dropped() const { return progress_.dropped; }  // number of dropped splats
  std::uint32_t splats() const { return splats_->total(); }

  // All ranks must call it; only the first one gets the model.
  SplatModel model() const { return splats_->download(); }
  DeviceModel& device_model() { return splats_->model(); }  // splats of this rank
  // Measures the present model on the test views, with the additional metrics of `more` if it is given. All
  // ranks must call it.
  Metrics evaluate_test(ImageMetrics* more = nullptr);
  // Measures the present model on at most `most` training views in full size, evenly chosen. Views of which
  // the mask leaves no pixel are not measured. Only for one process.
  Metrics evaluate_train(std::size_t most);
  // draw() renders the view of one of these cameras into renderer() of the first rank. All ranks must call
  // both methods.
  void set_cameras(const std::vector<Camera>& cameras) { passes_->set_cameras(cameras); }
  void draw(std::uint32_t camera) { passes_->draw(camera); }
  Renderer& renderer() { return passes_->renderer(); }

  TrainedCameras& cameras() { return cameras_; }
  Communicator& ranks() const { return ranks_; }
  // Returns null if there is one process.
  SharedViewPasses* shared() { return dynamic_cast<SharedViewPasses*>(passes_.get()); }

  double extent() const { return schedule_.extent(); }
  // Returns the computed device memory of this run, for the maximum number of intersections that a view has
  // had so far.
  MemoryPlan memory_plan() const;
  const IntersectionCount& intersections() const { return passes_->intersections(); }
  // Returns how the training time of this process was distributed over the stages, estimated from sampled
  // iterations.
  std::vector<StageTime> stage_times() const { return stages_->times(); }

 private:
  // The actions that follow after an iteration.
  struct Due {
    bool evaluates = false, saves = false;
    bool completes = false;  // see complete_in()
    bool reads = false;      // reads the loss
    bool looks = false;      // checks for values that are not finite
  };

  void step();
  StepViews views_of_step();
  bool refine();  // returns true if splats were moved or added
  void update(int views);
  void learn_appearances();
  bool refines_now() const { return schedule_.refines(progress_.iteration); }
  Regularise penalty() const;
  AdamStep next_step();
  void use_level_of(int iteration);

  Due due(double evaluated) const;
  void measure_sample(TestSample& sample, StepReport& report);
  bool save_due() const;
  void save_state();
  std::optional<double> read_loss();
  // Returns true if all values are finite; otherwise acts as on_nan requests, which may restore an earlier
  // state.
  bool look();
  void loss_not_finite(std::uint64_t draw);
  void answer(const NonFiniteEvent& event, TrainState state);
  bool at_point() const;                   // whether the time budget must set the next point now
  void set_pace(bool any_change = false);  // see BudgetPace::advance()
  void complete(double seconds);

  const TimeSource& time_;
  Communicator& ranks_;
  Device& device_;
  const std::uint32_t initial_;  // number of splats at the start
  Schedule schedule_;            // also holds the settings
  TrainingViews views_;
  std::unique_ptr<TimedStages> stages_;
  std::unique_ptr<TrainedSplats> splats_;
  std::unique_ptr<ViewPasses> passes_;
  LearntSky sky_;
  TrainedCameras cameras_;
  Buffer<float> rates_;  // of all parameter rows
  LossLog losses_;
  TrainProgress progress_;
  Guard guard_;
  std::optional<BudgetPace> pace_;      // only in a run with a time budget
  std::optional<double> completes_in_;  // set by complete_in(), until it takes effect
  std::optional<TrainProgress> completed_from_;
  bool whole_ = true, samples_ = false;
  StateSaving saving_;
  double saved_seconds_ = 0;
};

}  // namespace ubs
