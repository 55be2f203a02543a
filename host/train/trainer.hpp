// SPDX-License-Identifier: Apache-2.0
// Trainer optimises a splat model on the training views of a data set (method.md, section 4). TrainedScene
// (trained_scene.hpp) holds what is optimised and performs the iterations. Trainer decides how many
// iterations there are, and what happens between them: evaluations, checkpoints, reports, the handling of
// values that are not finite (Guard), and the adaptation to a time budget (RunLength). Training is
// reproducible: there is no hidden state. With the same settings, data, device and build, two runs give
// bit-identical models, also after a restore(). Runs with a time budget are an exception, because their
// length depends on the clock.
#pragma once

#include <functional>
#include <optional>

#include "host/train/guard.hpp"
#include "host/train/run_length.hpp"
#include "host/train/test_sample.hpp"
#include "host/train/trained_scene.hpp"

namespace ubs {

// StepReport is passed to on_step() after each iteration.
struct StepReport {
  int iteration = 0;   // number of the iteration, counted from 1
  int iterations = 0;  // number for the whole run; with a time budget, the current estimate
  double share = 0;    // share of the work that is done
  // Training time so far, without evaluations. In a run with a time budget, it includes the part of the
  // budget that passed before the first iteration; in other runs, it does not include the start-up.
  double seconds = 0;
  double seconds_left = 0;   // estimated training time that is left; 0 without a time budget
  std::uint32_t splats = 0;  // number of splats of all ranks
  // Mean loss over the views since the last logged iteration. Only present in logged iterations.
  std::optional<double> loss;
  std::optional<Metrics> test;        // only present after an evaluation
  std::optional<SampledPsnr> sample;  // only present after a measurement of a few test views
  // Returns seconds_left; without a time budget, returns an estimate from the iterations so far.
  double expected_left() const {
    if (seconds_left > 0 || iteration == 0) return seconds_left;
    return seconds / iteration * (iterations - iteration);
  }
};

// StateSaving determines when `save` is called with the state of the run: every `iterations` iterations and
// every `seconds` seconds of training. 0 disables the interval.
struct StateSaving {
  int iterations = 0;
  double seconds = 0;
  std::function<void(const TrainState&)> save;
};

class Trainer {
 public:
  // `train` must have images; `test` may be empty. Lengths in them, and in `initial`, are in units of the
  // training (Plan::unit). All references must outlive the trainer.
  // With several ranks, the splats and the views are divided among them, and the results are bit-identical to
  // those of one process (docs/cluster.md). All ranks must construct the same trainer, call run(), and make
  // the same calls of the other methods whose comments say that all ranks must call them. If the on_step() of
  // any rank returns false, all ranks stop.
  // `time` is the clock that measures the training time.
  Trainer(Device& device, const Plan& plan, const Split& train, const Split& test, const SplatModel& initial,
          Communicator& ranks = alone(), const TimeSource& time = steady_time());

  // Trains until the last iteration. on_step is called after every iteration and may return false to stop the
  // training. If an Error is thrown and state_is_consistent() returns true, the state is that of the last
  // completed iteration. A value that is not finite ends the run with Error(numerical), unless
  // settings.on_nan requests otherwise (docs/training.md).
  void run(const std::function<bool(const StepReport&)>& on_step);

  // Adapts the length of the run to a time budget. The plan must be the one that choose_iterations() has
  // returned for this budget. In a run that was started without a budget, the budget has no costs, and they
  // are estimated from the speed so far. The members iterations, work_shares and growth_end of settings()
  // then change during the run. Must be called before the first iteration, or before run() continues a
  // restored state. Not supported with several ranks.
  void keep_to(const TimeBudget& budget);
  // Makes run() also measure a few test views during training, if this takes little time (TestSample). This
  // has no effect on the model. Must be called before run(). Has no effect with several ranks.
  void sample_test() { samples_ = true; }
  // Ends the run early. Within about `seconds` seconds, the run performs the last part of its schedule, in
  // which the learning rates decrease to 0 (BudgetPace::complete). This part begins after the next iteration,
  // unless that is the last one. The state at this point is saved as requested by on_state(), and no later
  // state is saved, so that the run can also be resumed as if it had not been ended early. Must be called by
  // on_step(). Not supported with several ranks.
  void complete_in(double seconds);
  // Prepares a finished run to continue for about `seconds` seconds. The run then repeats the last part of
  // its schedule with the current splats. Must be called after keep_to() and before run().
  void go_on_for(double seconds);
  // Returns the progress of the run when complete_in() took effect, or nothing if it did not.
  const std::optional<TrainProgress>& completed_from() const { return completed_from_; }
  // Returns the settings of the run, with lengths in units of the training, and the plan with the length that
  // the run has now.
  const TrainSettings& settings() const { return scene_.settings(); }
  Plan plan() const;
  // Returns the scene as trained so far. The caller must not perform iterations with it.
  TrainedScene& scene() { return scene_; }
  const TrainedScene& scene() const { return scene_; }

  // Waits for the device and returns the state after the last iteration. All ranks must call this method.
  // With `everywhere`, the state contains all splats on every rank, otherwise each rank gets its part of the
  // splats.
  TrainState state(bool everywhere = false) const;
  // Replaces the state by that of a run with the same settings, data and device. If training then continues,
  // the results are bit-identical to those of an uninterrupted run. All ranks must call this method with the
  // same state, which contains all splats. The run that saved it may have had any number of ranks.
  void restore(const TrainState& state);
  // Returns whether the state is that of a completed iteration, and not of an iteration that has failed.
  bool state_is_consistent() const { return whole_; }
  // Sets when states are saved. The state is not saved after the last iteration, nor while it contains a
  // value that is not finite.
  void on_state(StateSaving saving) { saving_ = std::move(saving); }
  // `report` is called with a message each time training continues after a value that is not finite.
  void on_nonfinite(std::function<void(const std::string&)> report) { guard_.on_event(std::move(report)); }

  // These functions return the progress of the run: the last iteration, the training time, and what was done
  // because of values that are not finite.
  int iteration() const { return progress_.iteration; }
  double seconds() const { return progress_.seconds; }
  int rollbacks() const { return progress_.rollbacks; }
  std::uint64_t dropped() const { return progress_.dropped; }  // number of dropped splats
  std::uint32_t splats() const { return scene_.splats(); }

  // Downloads the model. All ranks must call this method; only the first rank gets the splats.
  SplatModel model() const { return scene_.model(); }
  // Measures the current model on the test views (TrainedScene::evaluate_test).
  Metrics evaluate_test(ImageMetrics* more = nullptr) { return scene_.evaluate_test(more, is_finished()); }
  // Returns an estimate of the device memory of this run, computed for the current capacity of the buffers.
  MemoryPlan memory_plan() const { return scene_.memory_plan(progress_.iteration); }

 private:
  // Due states which actions follow after an iteration.
  struct Due {
    bool evaluates = false, saves = false;
    bool completes = false;  // see complete_in()
    bool reads = false;      // reads the loss
    bool looks = false;      // checks for values that are not finite
  };

  bool is_finished() const { return progress_.iteration == settings().iterations; }

  void step();
  Due due(double evaluated) const;
  void measure_sample(TestSample& sample, StepReport& report);
  bool save_due() const;
  void save_state();
  std::optional<double> read_loss();
  // Returns true if all values are finite. Otherwise acts as settings().on_nan requests, which may restore an
  // earlier state, and returns false.
  bool look();
  void loss_not_finite(std::uint64_t draw);
  void answer(const NonFiniteEvent& event, TrainState state);

  const TimeSource& time_;
  const Plan plan_;
  Device& device_;
  TrainedScene scene_;
  TrainProgress progress_;
  RunLength length_;
  Guard guard_;
  std::optional<double> completes_in_;  // set by complete_in(), until it takes effect
  std::optional<TrainProgress> completed_from_;
  bool whole_ = true, samples_ = false;
  StateSaving saving_;
  double saved_seconds_ = 0;
};

}  // namespace ubs
