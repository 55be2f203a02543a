// SPDX-License-Identifier: Apache-2.0
// TrainedScene holds everything that training optimises: the splats, the exposures of the photographs, the
// background and the cameras. Its methods perform one iteration of the training loop (method.md, section 4),
// on one device, or on several MPI ranks that share the splats and the views (docs/cluster.md). Trainer
// decides how many iterations there are, and what happens between them.
// An iteration is reproducible: all random choices (order of views, noise, sampling for relocation) depend
// only on the seed and the number of the iteration.
#pragma once

#include <memory>
#include <vector>

#include "host/base/time_source.hpp"
#include "host/cluster/communicator.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/scene/dataset.hpp"
#include "host/settings/schedule.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/learnt_sky.hpp"
#include "host/train/loss_log.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/shared_view_passes.hpp"
#include "host/train/timed_stages.hpp"
#include "host/train/train_state.hpp"
#include "host/train/trained_cameras.hpp"
#include "host/train/training_views.hpp"

namespace ubs {

struct DrawLoss {
  std::uint64_t draw = 0;
  double loss = 0;
};

class TrainedScene {
 public:
  // The arguments are those of the constructor of Trainer; `settings` are those of its plan.
  TrainedScene(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
               const SplatModel& initial, Communicator& ranks, const TimeSource& time);

  // schedule() returns the schedule that the settings describe.
  const TrainSettings& settings() const { return schedule_.settings(); }
  const Schedule& schedule() const { return schedule_; }
  // Changes the schedule. Only iterations, work_shares and growth_end may differ from the current settings.
  void set_schedule(TrainSettings settings) { schedule_ = schedule_.with(std::move(settings)); }
  // Returns the settings in which the background is the one that has been learnt so far. Use these settings
  // to render the model outside of training.
  TrainSettings settings_with_learnt_background() const;
  RenderSettings render_settings() const { return passes_->settings(); }

  // The next three methods perform the iteration with the number progress.iteration. All ranks must call
  // them. differentiate() renders the views and computes the gradients. Returns the number of views that were
  // rendered, which excludes progress.skipped_draws. If it throws, for example because an image cannot be
  // read, nothing has changed.
  int differentiate(const TrainProgress& progress);
  // Relocates and adds splats if this is due, and otherwise takes the optimiser steps for the gradients of
  // `drawn` views. The steps record values that are not finite in `sentinel` (see Guard).
  void learn(TrainProgress& progress, int drawn, BufferView<std::uint32_t> sentinel);
  // Starts to upload the first photograph of the next iteration, in parallel with the first operations of
  // that iteration. Throws if the image cannot be read.
  void upload_next(int iteration);

  // Waits for the device and returns the losses of all draws that were rendered since iteration
  // progress.logged, but at most of the last `log_every` iterations. All ranks must call this method.
  std::vector<DrawLoss> losses(const TrainProgress& progress) const;
  // Replaces decisions that depend on the clock, as ViewPasses::agree() does.
  void agree(std::span<bool> decisions, BufferView<std::uint32_t> sentinel, int iteration) const {
    passes_->agree(decisions, sentinel, iteration);
  }
  // Selects the size of the training images for this iteration.
  void use_level_of(int iteration);

  // Stores the optimised values and the losses in `state`, or replaces them by those of `state`. See
  // Trainer::state() and Trainer::restore().
  void save(TrainState& state, bool everywhere) const;
  void load(const TrainState& state);

  std::uint32_t splats() const { return splats_->total(); }  // number of splats of all ranks
  // Downloads the model. All ranks must call this method; only the first rank gets the splats.
  SplatModel model() const { return splats_->download(); }
  DeviceModel& device_model() { return splats_->model(); }  // splats of this rank
  TrainingViews& views() { return views_; }
  const TrainingViews& views() const { return views_; }
  TrainedCameras& cameras() { return cameras_; }
  const TrainedCameras& cameras() const { return cameras_; }
  TimedStages& stages() { return *stages_; }
  const TimedStages& stages() const { return *stages_; }
  Communicator& ranks() const { return ranks_; }
  // Returns the passes of a run with several ranks, or null if there is only one rank.
  SharedViewPasses* shared() { return dynamic_cast<SharedViewPasses*>(passes_.get()); }

  // Measures the current model on the test views. If `more` is not null, its additional metrics are measured
  // too. If cameras are refined and `last` is set, the test views are also measured from cameras that are
  // fitted to the model. All ranks must call this method.
  Metrics evaluate_test(ImageMetrics* more, bool last);
  // Measures the current model on at most `most` training views, which are evenly spaced, in full size. Views
  // whose mask excludes all pixels are not measured. Not supported with several ranks.
  Metrics evaluate_train(std::size_t most);
  // Returns the PSNR of one test view. Not supported with several ranks.
  double test_psnr(std::uint32_t view) { return passes_->test_psnr(view); }
  // set_cameras() sets the cameras for draw(), and draw() renders the view of one of them. The image is then
  // in renderer() of the first rank. All ranks must call both methods.
  void set_cameras(const std::vector<Camera>& cameras) { passes_->set_cameras(cameras); }
  void draw(std::uint32_t camera) { passes_->draw(camera); }
  Renderer& renderer() { return passes_->renderer(); }

  // Returns an estimate of the device memory of a run after this iteration, computed for the current capacity
  // of the buffers.
  MemoryPlan memory_plan(int iteration) const;
  const IntersectionCount& intersections() const { return passes_->intersections(); }

 private:
  StepViews views_of(const TrainProgress& progress);
  bool refine(int iteration);  // returns true if splats were moved or added
  void update(TrainProgress& progress, int views, BufferView<std::uint32_t> sentinel);
  void learn_appearances(const TrainProgress& progress, BufferView<std::uint32_t> sentinel);
  Regularise penalty(int iteration) const;

  Communicator& ranks_;
  Device& device_;
  Schedule schedule_;  // also holds the settings
  TrainingViews views_;
  std::unique_ptr<TimedStages> stages_;
  std::unique_ptr<TrainedSplats> splats_;
  std::unique_ptr<ViewPasses> passes_;
  LearntSky sky_;
  TrainedCameras cameras_;
  Buffer<float> rates_;  // learning rates of all parameter rows
  LossLog losses_;
};

}  // namespace ubs
