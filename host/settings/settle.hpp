// SPDX-License-Identifier: Apache-2.0
// settle() makes a Plan of the settings that were asked for. It is the only place where automatic settings
// get their values. Each value follows from the rule in its row of the table of fields (train_settings.cpp).
#pragma once

#include <string>
#include <vector>

#include "host/settings/facts.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {

// A Plan is what a training does: settings of which no value is automatic. (Only init_extent may be: the
// splats are then placed in the space that the cameras see.) The length of the run may change later: a run
// with a time budget adapts iterations, work_shares and growth_end (host/train/run_length.hpp).
class Plan {
 public:
  // `complete` are settings in the unit of the data. Throws Error(internal) if one of them is automatic.
  explicit Plan(TrainSettings complete);

  // Returns the settings with lengths in units of the training, in which the unit is 1.
  const TrainSettings& settings() const { return trained_; }
  // Returns the settings with lengths in the unit of the data, as config.yaml and checkpoints contain them.
  const TrainSettings& recorded() const { return recorded_; }
  // Returns the length in the data that is 1 during training.
  double unit() const { return recorded_.unit; }
  // Takes over the settings that change during a run: iterations, work_shares and growth_end.
  void set_length(const TrainSettings& from);

 private:
  TrainSettings recorded_, trained_;
};

struct Settled {
  Plan plan;
  std::vector<std::string> notes;     // choices that the user should know about, a line each
  std::vector<std::string> warnings;  // settings or data that will probably give a bad model
};

// Decides the automatic settings. The result only depends on the arguments. A budget is ignored: the run gets
// the number of iterations that it would have without one (choose_iterations() in host/train/time_budget.hpp
// finds the number that fits). Throws Error(usage) or Error(data) for settings that do not suit the data.
Settled settle(const TrainSettings& asked, const Facts& facts);
// The same for data about which nothing is known, for example those of a test.
Plan settle(const TrainSettings& asked);

// Returns the number of initial points to triangulate from the images, which is needed before the facts of
// the data can be complete. `moves`: the views have different times.
int points_to_find(const TrainSettings& asked, bool moves);
// Returns the number of splats at the start of a run.
std::size_t first_splats(const TrainSettings& settled, const Facts& facts);
// Returns the keys of the settings that differ between `asked` and `settled`.
std::vector<std::string> changed_keys(TrainSettings asked, TrainSettings settled);

}  // namespace ubs
