// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/estimate.hpp"

#include <algorithm>
#include <string_view>

#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/experiment/child_process.hpp"

namespace ubs::experiment {
namespace {

namespace fs = std::filesystem;

Estimate plan_of(const Job& job, const EstimateOptions& options) {
  const fs::path spec = options.work / kJobSettings, log = options.work / "plan.log";
  TrainSettings settings = job.settings;
  write_file_atomically(spec, to_yaml(bind_fields(settings, train_fields())));
  std::vector<std::string> command{
      options.executable.string(), "plan", "--data", job.data.string(), "--spec", spec.string(), "--json"};
  if (!options.device.empty()) command.insert(command.end(), {"--device", options.device});
  const ChildResult end =
      run_child(command, log, [&] { return options.interrupted() ? Request::kill : Request::none; });
  Estimate estimate;
  estimate.own = true;
  if (end.code != 0 || end.signal != 0) {
    estimate.problem = reason_of(end.code, end.signal, log, false);
    return estimate;
  }
  const std::string text = read_text_file(log);  // remarks of the process and its JSON
  const std::size_t first = text.find("\n{") + 1, last = text.rfind("\n}") + 2;
  estimate.plan = parse_own_json(std::string_view(text).substr(first, last - first), "output of ubs plan");
  estimate.hours = estimate.plan.at("seconds").get<double>() / 3600;
  return estimate;
}

bool same_plan(const Job& a, const Job& b) {
  return a.set == b.set && a.width == b.width && changed_settings(a.settings, b.settings).empty();
}

}  // namespace

std::vector<Estimate> estimate_hours(const std::vector<Job>& jobs, const EstimateOptions& options) {
  std::vector<Estimate> estimates(jobs.size());
  for (std::size_t i = 0; i < jobs.size() && !options.interrupted(); ++i) {
    const Job& job = jobs[i];
    Estimate& estimate = estimates[i];
    if (!job.runnable()) continue;
    const auto own = jobs.begin() + static_cast<std::ptrdiff_t>(i);
    const auto earlier = std::find_if(
        jobs.begin(), own, [&](const Job& other) { return other.runnable() && same_plan(other, job); });
    if (earlier != own) {
      estimate = estimates[static_cast<std::size_t>(earlier - jobs.begin())];
      estimate.own = false;
      continue;
    }
    estimate = plan_of(job, options);
    if (options.say)
      options.say(fmt::format("{}: {}", job.id,
                              estimate.hours ? fmt::format("{:.3f} h", *estimate.hours) : estimate.problem));
  }
  return estimates;
}

}  // namespace ubs::experiment
