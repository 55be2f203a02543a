// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/runner.hpp"

#include <csignal>
#include <cstring>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/folder_lock.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/experiment/child_process.hpp"
#include "host/experiment/measure.hpp"

namespace ubs::experiment {
namespace {

namespace fs = std::filesystem;

constexpr int kInterruptedCode = 130;

// Asked to end, by this program or by the terminal, which asks both; also before it was prepared for that.
bool is_interrupted(const ChildResult& end, const RunOptions& options) {
  if (end.signal == 0) return end.code == kInterruptedCode;
  return options.interrupted() && (end.signal == SIGINT || end.signal == SIGTERM || end.signal == SIGHUP);
}

// A request behind the last step leaves a whole run, whose checkpoint has gone.
bool is_complete(const fs::path& run) {
  return path_exists(run / "metrics.json") && !path_exists(run / "checkpoint.ubs");
}
constexpr const char* kErrorPrefix = "ubs: error: ";

// Hands on what is new in a growing file, line by line.
class LogFollower {
 public:
  LogFollower(fs::path path, const std::function<void(const std::string&)>& say)
      : path_(std::move(path)), say_(say) {}

  void poll() {
    if (!say_) return;
    std::ifstream stream(path_, std::ios::binary);
    if (!stream.seekg(static_cast<std::streamoff>(read_))) return;
    for (std::string line; std::getline(stream, line) && !stream.eof();) {
      read_ += line.size() + 1;
      if (line.find(" it/s") != std::string::npos || line.starts_with("ubs: ")) say_("    " + line);
    }
  }

 private:
  fs::path path_;
  const std::function<void(const std::string&)>& say_;
  std::size_t read_ = 0;
};

JobResult failure(const std::string& reason, int code) {
  return {.state = JobState::failed, .reason = reason, .values = {}, .record = {}, .code = code};
}

std::vector<std::string> train_command(const Job& job, const fs::path& folder, bool goes_on,
                                       const RunOptions& options) {
  std::vector<std::string> command{options.executable.string(), "train", "--data", job.data.string()};
  if (goes_on)
    command.insert(command.end(), {"--resume", folder.string()});
  else
    command.insert(command.end(),
                   {"--out", folder.string(), "--spec", (folder / kJobSettings).string(), "--overwrite"});
  if (!options.device.empty()) command.insert(command.end(), {"--device", options.device});
  command.insert(command.end(), options.train_arguments.begin(), options.train_arguments.end());
  return command;
}

// What `ubs train --resume` says of a damaged checkpoint or one of another version (read_checkpoint()), and
// of another device or other data (check_same_run()). Any other error, such as a full disk, leaves the state
// to go on from.
bool is_refused(const std::string& reason) {
  return reason.find("/checkpoint.ubs: ") != std::string::npos ||
         reason.find("the run was started") != std::string::npos;
}

JobResult train(const Job& job, const JobFolder& folder, const Json& identity, const RunOptions& options,
                bool resume) {
  const bool goes_on = folder.begin(job.settings, identity, resume);
  const fs::path log = folder.partial_path() / "train.log";
  LogFollower follower(log, options.say);
  const std::vector<std::string> command = train_command(job, folder.partial_path(), goes_on, options);
  const std::string begun = options.date();
  const ChildResult end = run_child(command, log, [&] {
    follower.poll();
    return options.interrupted() ? Request::interrupt : Request::none;
  });
  follower.poll();
  if (is_interrupted(end, options)) {
    if (!is_complete(folder.partial_path()))
      return {JobState::interrupted, "what it had is in " + folder.partial_path().string(), {}, {}};
  } else if (end.signal != 0 || end.code != 0) {
    const std::string reason = reason_of(end.code, end.signal, log);
    if (goes_on && is_refused(reason)) return train(job, folder, identity, options, false);
    return failure(reason, end.signal != 0 ? exit_code(ErrorKind::internal) : end.code);
  }
  Json more = options.environment;
  more["begun"] = begun;
  more["ended"] = options.date();
  if (options.key) more["key"] = options.key(job);
  return folder.commit(identity, more);
}

std::string values_text(const JobResult& result) {
  std::string text;
  for (const Metric& metric : metrics())
    if (const auto at = result.values.find(metric.key); at != result.values.end())
      text += fmt::format("{}{} {:.{}f}", text.empty() ? "" : ", ", metric.name, at->second, metric.decimals);
  return text;
}

// What is known before anything runs: data that are not there, runs that cannot start, results of earlier.
JobResult known_before(const Job& job, const RunOptions& options, std::string& remark) {
  if (job.data.empty()) return {JobState::missing, "looked for " + job.looked_for, {}, {}};
  if (!job.problem.empty()) return failure(job.problem, job.problem_code);
  if (!options.resume) return {};
  const JobFolder folder(options.out / "runs", job);
  JobResult done = folder.completed(identity_of(job, options.train_arguments), remark).value_or(JobResult());
  if (options.same_key && done.state == JobState::done && done.record.value("key", "") != options.key(job)) {
    remark = "another build or device";
    return {};
  }
  return done;
}

JobResult run_one(const Job& job, const RunOptions& options) {
  try {
    return train(job, JobFolder(options.out / "runs", job), identity_of(job, options.train_arguments),
                 options, options.resume);
  } catch (const Error& error) {
    return failure(error.what(), exit_code(error.kind()));
  }
}

// What the other ranks made of their jobs: whole runs from the disk, and of the others why they are not.
void collect(const std::vector<Job>& jobs, const RunOptions& options, const std::vector<bool>& own,
             std::vector<JobResult>& results) {
  Json mine = Json::array();
  for (std::size_t i = 0; i < jobs.size(); ++i)
    if (own[i])
      mine.push_back(
          {i, static_cast<int>(results[i].state), results[i].reason, results[i].lacks, results[i].code});
  for (const std::string& text : options.ranks->all_texts(json_text(mine)))
    for (const Json& one : parse_own_json(text, "results of another rank")) {
      const auto i = one[0].get<std::size_t>();
      if (own[i]) continue;
      std::string remark;
      const JobFolder folder(options.out / "runs", jobs[i]);
      const auto done = folder.completed(identity_of(jobs[i], options.train_arguments), remark);
      if (static_cast<JobState>(one[1].get<int>()) == JobState::done && done)
        results[i] = *done;
      else
        results[i].state = static_cast<JobState>(one[1].get<int>());
      results[i].reason = one[2].get<std::string>();
      results[i].lacks = one[3].get<std::map<std::string, std::string>>();
      results[i].code = one[4].get<int>();
    }
}

// The first rank that comes to a job has it, until all ranks are through.
std::unique_ptr<FolderLock> claim(const Job& job, const RunOptions& options) {
  if (options.ranks->size() == 1) return nullptr;
  return std::make_unique<FolderLock>(options.out / "runs" / (job.folder_name() + ".claim"));
}

std::string result_text(const JobResult& result) {
  if (result.state == JobState::done) return values_text(result);
  return fmt::format("{}: {}", to_string(result.state), result.reason);
}

}  // namespace

std::string reason_of(int code, int signal, const fs::path& log, bool log_stays) {
  std::string reason, last;
  std::ifstream stream(log);
  for (std::string line; std::getline(stream, line);) {
    if (line.starts_with(kErrorPrefix)) reason = line.substr(std::strlen(kErrorPrefix));
    if (!line.empty()) last = line;
  }
  const std::string more = log_stays ? "; see " + log.string() : fmt::format(" behind '{}'", last);
  if (signal != 0) return fmt::format("ended by signal {} ({}){}", signal, strsignal(signal), more);
  return reason.empty() ? fmt::format("exit code {}{}", code, more)
                        : fmt::format("{} (exit code {})", reason, code);
}

std::vector<JobResult> run_jobs(const std::vector<Job>& jobs, const RunOptions& options) {
  make_folders(options.out / "runs");
  const auto say = [&](std::size_t i, const std::string& text) {
    if (options.say) options.say(fmt::format("[{}/{}] {}: {}", i + 1, jobs.size(), jobs[i].id, text));
  };
  std::vector<JobResult> results;
  std::vector<std::string> remarks(jobs.size());
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    results.push_back(known_before(jobs[i], options, remarks[i]));
    if (results[i].state != JobState::pending)
      say(i, (results[i].state == JobState::done ? "kept: " : "") + result_text(results[i]));
  }
  options.ranks->be_patient();
  options.ranks->of_first(0);  // no rank trains before all have looked at what there was before
  std::vector<std::unique_ptr<FolderLock>> claims;
  std::vector<bool> own(jobs.size());
  for (std::size_t i = 0; i < jobs.size() && !options.interrupted(); ++i) {
    try {
      claims.push_back(claim(jobs[i], options));
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::usage) throw;
      continue;
    }
    own[i] = true;
    const bool kept = results[i].state == JobState::done;
    if (!kept && results[i].state != JobState::pending) continue;
    if (!kept) {
      say(i, fmt::format("training on {}{}", jobs[i].data.string(),
                         remarks[i].empty() ? "" : " (" + remarks[i] + ")"));
      results[i] = run_one(jobs[i], options);
    }
    const std::size_t known = results[i].values.size();
    if (results[i].state == JobState::done)
      measure(jobs[i], JobFolder(options.out / "runs", jobs[i]).final_path(), options, results[i]);
    if (!kept || results[i].values.size() > known) say(i, result_text(results[i]));
    if (options.on_progress) options.on_progress(results);
    if (results[i].state == JobState::interrupted) break;
  }
  if (options.ranks->size() > 1) collect(jobs, options, own, results);
  return results;
}

}  // namespace ubs::experiment
