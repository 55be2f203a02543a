// SPDX-License-Identifier: Apache-2.0
// Trainer learns a splat model from the training views of a data set: the loop of method.md section 4 over
// the stages of a device. No state is hidden: the order of views, the noise and the sampling of relocation
// follow from (seed, iteration) alone, so a run is determined by settings, data, device and binary. Its
// parts: Schedule decides what happens when, TrainingViews which view comes, ViewPasses draws it,
// TrainedSplats holds what is learnt, Guard watches for values that are not finite, and BudgetPace keeps to a
// time budget.
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
#include "host/train/time_budget.hpp"
#include "host/train/timed_stages.hpp"
#include "host/train/trained_cameras.hpp"
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
  const TrainSettings& settings() const { return schedule_.settings(); }
  // The settings with the background that has been learnt so far: how the model is drawn elsewhere.
  TrainSettings drawn_settings() const;
  RenderSettings render_settings() const { return passes_->settings(); }

  // The state after the last iteration. Waits. All ranks; each gets its part of the splats, or with
  // `everywhere` all of them.
  TrainState state(bool everywhere = false) const;
  // Goes on from a state of a run with the same settings, data and device: with the same bits. All ranks,
  // with the same state; the run that it is from may have had any number of them.
  void restore(const TrainState& state);
  bool state_is_whole() const { return whole_; }
  // The state is not handed out after the last iteration, nor while it holds a value that is not finite.
  void on_state(StateSaving saving) { saving_ = std::move(saving); }
  // Called with a message for every value that is not finite after which training goes on.
  void on_nonfinite(std::function<void(const std::string&)> report) { guard_.on_event(std::move(report)); }

  // How far the run is.
  int iteration() const { return progress_.iteration; }
  double seconds() const { return progress_.seconds; }
  int rollbacks() const { return progress_.rollbacks; }
  std::uint64_t dropped() const { return progress_.dropped; }  // splats
  std::uint32_t splats() const { return splats_->total(); }

  SplatModel model() const { return splats_->download(); }  // all ranks; the first one gets it
  DeviceModel& device_model() { return splats_->model(); }  // of this rank
  // Of the model as it is now; with `more` also what that measures. All ranks.
  Metrics evaluate_test(ImageMetrics* more = nullptr);
  // Draws a view of these cameras into renderer() of the first rank. All ranks.
  void set_cameras(const std::vector<Camera>& cameras) { passes_->set_cameras(cameras); }
  void draw(std::uint32_t camera) { passes_->draw(camera); }
  Renderer& renderer() { return passes_->renderer(); }

  TrainedCameras& cameras() { return cameras_; }
  Communicator& ranks() const { return ranks_; }
  SharedViewPasses* shared() { return shared_; }  // null: one process

  double extent() const { return schedule_.extent(); }
  // Device memory of this run as counted beforehand, for the most intersections that a view has had so far.
  MemoryPlan memory_plan() const;
  const IntersectionCount& intersections() const { return passes_->intersections(); }
  // Where the training time of this process went, estimated from sampled iterations.
  std::vector<StageTime> stage_times() const { return stages_->times(); }

 private:
  // What happens after an iteration.
  struct Due {
    bool evaluates = false, saves = false;
    bool reads = false;  // the loss
    bool looks = false;  // for values that are not finite
  };

  // The parts of one process, or of one rank of several.
  std::unique_ptr<TrainedSplats> all_or_own_splats(const SplatModel& initial);
  std::unique_ptr<ViewPasses> all_or_own_passes();

  void step();
  StepViews views_of_step();
  bool refine();  // true when splats moved or were added
  void update(int views);
  void learn_appearances();
  bool refines_now() const { return schedule_.refines(progress_.iteration); }
  Regularise penalty() const;
  AdamStep next_step();
  void use_level_of(int iteration);

  Due due(double evaluated) const;
  void agree(bool& by_time, bool& saves) const;
  bool save_due() const;
  void save_state();
  std::optional<double> read_loss();
  bool look();  // true when all is finite; else has done what on_nan says, and may have gone back
  void loss_not_finite(std::uint64_t draw);
  void answer(const NonFiniteEvent& event, TrainState state);
  bool at_point() const;  // where a time budget sets the speed of the run
  void set_pace();

  const TimeSource& time_;
  Communicator& ranks_;
  Device& device_;
  const std::uint32_t initial_;  // splats at the start
  Schedule schedule_;            // with the settings
  TrainingViews views_;
  std::unique_ptr<TimedStages> stages_;
  std::unique_ptr<TrainedSplats> splats_;
  std::unique_ptr<ViewPasses> passes_;
  SharedViewPasses* const shared_;  // the same, where there are several ranks; else null
  LearntSky sky_;
  TrainedCameras cameras_;
  Buffer<float> rates_;  // of all rows
  LossLog losses_;
  TrainProgress progress_;
  Guard guard_;
  std::optional<BudgetPace> pace_;  // of a run with a time budget
  bool whole_ = true;
  StateSaving saving_;
  double saved_seconds_ = 0;
};

}  // namespace ubs
