// SPDX-License-Identifier: Apache-2.0
// Runs the jobs of an experiment one after another, each as `ubs train` in a process of its own
// (child_process.hpp says why), and survives all of them.
#pragma once

#include "host/cluster/communicator.hpp"
#include "host/experiment/job_folder.hpp"

namespace ubs::experiment {

// What is measured of finished runs (measure.hpp).
struct MeasureOptions {
  int fps_views = 20;                   // drawn to measure frames a second; 0: none
  std::filesystem::path lpips_weights;  // of VGG16, as --lpips-weights takes them; empty: no LPIPS
  std::string why_no_lpips;             // for the table, where there are no weights
};

struct RunOptions {
  std::filesystem::path out;                 // "runs" below it holds the folders of jobs
  std::filesystem::path executable;          // ubs
  std::string device;                        // for --device; empty: the usual choice
  std::vector<std::string> train_arguments;  // further ones
  MeasureOptions measure{};
  bool resume = false;                          // keep complete results of the same settings
  Json environment;                             // goes into every job.json
  std::function<std::string(const Job&)> key;   // likewise, as "key"; may be empty
  bool same_key = false;                        // `resume` keeps results of the same key only
  Communicator* ranks = &alone();               // that share the jobs, and the folder `out`
  std::function<std::string()> date;            // of now
  std::function<bool()> interrupted;            // asked often; true ends the running job in order
  std::function<void(const std::string&)> say;  // lines for people
  std::function<void(const std::vector<JobResult>&)> on_progress;  // after every job, for the table
};

// One result per job, in order; on several ranks the first one has all of them. A failing job is a result
// like others; after an interruption the rest is pending. Throws only where nothing can be written.
std::vector<JobResult> run_jobs(const std::vector<Job>& jobs, const RunOptions& options);

// Why a process ended: its "ubs: error: ..." line, else the signal or the exit code, with the log's name, or
// its last line where it does not stay.
std::string reason_of(int code, int signal, const std::filesystem::path& log, bool log_stays = true);

}  // namespace ubs::experiment
