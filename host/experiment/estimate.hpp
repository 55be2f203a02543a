// SPDX-License-Identifier: Apache-2.0
// How long the jobs of an experiment will take, from short real training runs (`ubs train` in a process of
// its own, killed after a few seconds) on their own data: once with the splats that training starts with,
// once grown to cap_max at once. Between them the time of a step is taken as linear in the number of splats,
// and summed over the growth that the schedule prescribes.
#pragma once

#include "host/experiment/runner.hpp"

namespace ubs::experiment {

struct StepTime {
  double seconds = 0;  // an iteration: the mean over the samples
  std::uint64_t splats = 0;
  std::size_t samples = 0;
  std::string problem;  // why there is none
};

struct Estimate {
  StepTime start, cap;  // cap: empty samples where training does not grow
  std::optional<double> hours;
  bool measured = false;  // false: taken over from an equal job
};

struct EstimateOptions {
  std::filesystem::path executable, work;  // work: an empty folder for the short runs
  std::string device;
  std::vector<std::string> train_arguments;
  double seconds = 3;     // of training a measurement, after two samples of warming up
  double patience = 600;  // seconds after which a measurement is given up (loading included)
  std::function<bool()> interrupted;
  std::function<void(const std::string&)> say;
};

// One estimate per job; jobs that cannot run have none. Jobs with the same settings, data set and image width
// share one measurement.
std::vector<Estimate> estimate_hours(const std::vector<Job>& jobs, const EstimateOptions& options);

// Seconds of a whole training whose step takes `start.seconds` at `start.splats` and so on.
double training_seconds(const TrainSettings& settings, const StepTime& start, const StepTime& cap);

// Seconds an iteration from the text of a log.csv: the mean over its rows, the first `warm_up` left out.
StepTime step_time(const std::string& log_csv, std::size_t warm_up);

}  // namespace ubs::experiment
