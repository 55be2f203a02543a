// SPDX-License-Identifier: Apache-2.0
// TrainingRun is the course of a training, from a data set and the settings that were asked for to a trained
// model. `ubs train`, `ubs plan`, `ubs-lab compare` and the C interface use it, so the same settings and data
// give the same plan in all of them. The steps are:
//   1. The constructor takes the training and test views, determines the facts about the data, and settles
//      the plan.
//   2. use() tells which kernels the caller has to verify on the device (verified_device.hpp).
//   3. fit_to_budget() measures steps and chooses the number of iterations, if there is a budget.
//   4. initial() makes the model that training starts with. The caller may use another one.
//   5. warm_up() compiles the kernels, and start() makes the Trainer. Its run() trains.
//   6. model(), notes() and comments() return the result in the unit of the data.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/check/gate.hpp"
#include "host/cluster/communicator.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/formats/model_notes.hpp"
#include "host/pipeline/image_metrics.hpp"
#include "host/settings/settle.hpp"
#include "host/train/checkpoint.hpp"
#include "host/train/trainer.hpp"

namespace ubs {

class TrainingRun {
 public:
  // The images in `data` are not copied. `begins` says whether training starts with a new model; if not, no
  // points are searched for. Logs warnings about settings and data that will probably give a bad model.
  // Throws an error if the data cannot be trained with these settings.
  TrainingRun(std::shared_ptr<const Dataset> data, TrainSettings asked, bool begins = true);
  TrainingRun(const TrainingRun&) = delete;
  TrainingRun& operator=(const TrainingRun&) = delete;

  // Returns the plan. After start(), it contains the length that the run has now.
  Plan plan() const { return trainer_ ? trainer_->plan() : *plan_; }
  // Returns what the loader has found, and the choices that were made for this run.
  const LoadReport& report() const { return rest_.report; }
  const std::array<double, 3>& offset() const { return rest_.offset; }
  // Returns the keys of the settings that were chosen from the data when the run was settled.
  const std::vector<std::string>& chosen() const { return chosen_; }
  // The views that are trained and those that are measured. Lengths are in units of the training.
  const Split& train() const { return train_; }
  const Split& test() const { return test_; }
  // Logs a warning if there are no test views, or if some of them have no image and are not used.
  void warn_about_test() const;
  // Returns the cameras of the training views, aligned, in the unit of the data.
  const std::vector<Camera>& cameras() const { return cameras_; }
  // Returns the fingerprint() of the training views as they are in the data.
  std::uint32_t data_print() const { return data_print_; }

  // Returns the kernels that training needs.
  check::Use use() const;
  // Compiles the kernels for a training with this plan that starts with this model.
  void warm_up(Device& device, const Plan& plan, const SplatModel& initial, Communicator& ranks = alone(),
               ImageMetrics* networks = nullptr) const;

  // If the settings ask for a budget, chooses the largest number of iterations that is expected to fit, and
  // settles the plan again. `warm` compiles kernels (warm_up()); `spent` returns the seconds of the budget
  // that have passed. Throws Error(usage) if the budget is too short.
  double time_limit() const { return budget_seconds(asked_); }  // [s]; 0: none
  void fit_to_budget(Device& device, const std::function<void(const Plan&, const SplatModel&)>& warm,
                     const std::function<double()>& spent);
  // Returns the budget for Trainer::keep_to(), of which `spent` seconds have passed. Its `seconds` are 0 if
  // there is none.
  TimeBudget budget_from(double spent) const;

  // Returns the initial model, with at most cap_max splats, in units of the training. The splats are placed
  // at the points of the data, if there are any. Otherwise they are placed at random: between the depth
  // bounds, if the data state them; otherwise in the box of size init_extent, if this setting is set;
  // otherwise in the space that the cameras see (host/scene/camera_rig.hpp).
  SplatModel initial() const;
  // Makes the trainer. The device and `ranks` must outlive it.
  Trainer& start(Device& device, const SplatModel& initial, Communicator& ranks = alone());
  Trainer& trainer() { return *trainer_; }
  const Trainer& trainer() const { return *trainer_; }

  // These functions return the model that is trained so far in the unit of the data, and what the header of
  // its file contains in addition to the splats.
  SplatModel model() const;
  ModelNotes notes() const;
  std::vector<std::string> comments() const;
  // Returns the settings with the background that was learnt so far.
  TrainSettings settings_with_learnt_background() const;

 private:
  std::shared_ptr<const Dataset> data_;
  const TrainSettings asked_;
  Dataset rest_;  // without views; lengths in units of the training
  Split train_, test_;
  std::size_t test_without_image_ = 0;
  std::uint32_t data_print_ = 0;
  std::vector<Camera> cameras_;
  Facts facts_;
  std::optional<Plan> plan_;  // is set by the constructor
  std::vector<std::string> chosen_;
  TimeBudget budget_;
  std::optional<Trainer> trainer_;
};

// Returns the information that the header of a model file contains in addition to the splats. `cameras` are
// those of the training views, in the unit of the data.
ModelNotes notes_for(const TrainSettings& settings, std::span<const Camera> cameras);
// Returns the same information as comment lines, with the offset of the data if it is not zero.
std::vector<std::string> model_comments(const std::array<double, 3>& offset, const TrainSettings& settings,
                                        std::span<const Camera> cameras);

}  // namespace ubs
