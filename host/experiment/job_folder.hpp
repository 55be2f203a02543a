// SPDX-License-Identifier: Apache-2.0
// The results of one training run on disk. A run works in "<name>.partial"; only when it has ended in order
// is job.json added and the folder renamed to "<name>". So a folder without ".partial" is whole, whenever the
// program was killed, and job.json says what it is the result of.
#pragma once

#include <nlohmann/json.hpp>

#include "host/base/json.hpp"
#include "host/experiment/plan.hpp"

namespace ubs::experiment {

enum class JobState {
  done,         // measured after its last iteration
  missing,      // its data are not there
  failed,       // see reason
  interrupted,  // ended early; what it had is in its partial folder
  pending       // not run yet
};
const char* to_string(JobState state);

struct JobResult {
  JobState state = JobState::pending;
  std::string reason;                    // of states other than done; or what a measurement lacks
  std::map<std::string, double> values;  // by Metric::key, as far as they were measured
  Json record;                           // job.json: settings, device, version, build, commit, date, ...
  std::map<std::string, std::string> lacks{};  // by Metric::key: why a finished run was not measured for it
  int code = 0;                                // of a failed run: exit code
};

constexpr const char* kJobSettings = "job.yaml";

class JobFolder {
 public:
  // `runs` holds the folders of all jobs.
  JobFolder(std::filesystem::path runs, const Job& job);

  const std::filesystem::path& final_path() const { return final_; }
  const std::filesystem::path& partial_path() const { return partial_; }

  // The result of an earlier run with this identity; empty, with the reason in `why_not`, where there is
  // none.
  std::optional<JobResult> completed(const Json& identity, std::string& why_not) const;
  // A new partial folder, with the settings for `ubs train --spec` in kJobSettings. One that was there goes
  // where it holds nothing but results of this program, unchanged, and is renamed else; but with `resume` it
  // stays, and the answer is true, where it has the checkpoint of a run with this identity. Throws
  // Error(usage) while a training runs in it.
  bool begin(const TrainSettings& settings, const Json& identity, bool resume) const;
  // Checks what training left in the partial folder, adds job.json and gives the folder its final name.
  JobResult commit(const Json& identity, const Json& more) const;

 private:
  std::filesystem::path final_, partial_;
};

// What decides a result: settings, data folder, further arguments of training. Equal identities, equal
// results (on one device and build).
Json identity_of(const Job& job, const std::vector<std::string>& train_arguments);
std::string hash_of(const Json& identity);  // 16 hexadecimal digits

// The metrics in a metrics.json of `ubs train`, and in an eval.json of `ubs eval` beside it; what they do not
// have is left out. Throws Error(data) naming the file when it is none, was interrupted, or was not measured
// after the last iteration.
std::map<std::string, double> read_metrics(const std::filesystem::path& folder);

}  // namespace ubs::experiment
