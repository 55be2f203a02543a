// SPDX-License-Identifier: Apache-2.0
// How long the jobs of an experiment will take, by `ubs plan` on their own data, each in a process of its
// own.
#pragma once

#include "host/experiment/runner.hpp"

namespace ubs::experiment {

struct Estimate {
  std::optional<double> hours;
  Json plan;            // as `ubs plan --json` prints it; null where there is none
  std::string problem;  // why
  bool own = false;     // false: taken over from an equal job
};

struct EstimateOptions {
  std::filesystem::path executable, work;  // work: a folder for the settings and the output of a plan
  std::string device;
  std::function<bool()> interrupted;
  std::function<void(const std::string&)> say;
};

// One estimate per job; jobs that cannot run have none. Jobs with the same settings, data set and image width
// share one.
std::vector<Estimate> estimate_hours(const std::vector<Job>& jobs, const EstimateOptions& options);

}  // namespace ubs::experiment
