// SPDX-License-Identifier: Apache-2.0
#include "tests/fault/campaign.hpp"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <sstream>

#include "host/train/checkpoint.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs::test {
namespace {

namespace fs = std::filesystem;

// Foreign files: the test puts them into the output folder, and no command may change them.
constexpr const char* kForeign[] = {"mine.txt", "renders/mine.png", "other/mine.csv"};

bool is_temporary(const std::string& path) { return path.find("tmp-") != std::string::npos; }
// Returns whether the path is that of a list of outputs or of a lock. ubs writes these files, but they are
// not results.
bool is_own_trace(const std::string& path) { return path.find(".ubs-") != std::string::npos; }

Snapshot snapshot(const fs::path& folder) {
  Snapshot files;
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) files[fs::relative(entry.path(), folder).string()] = get(entry.path());
  return files;
}

bool warned(const std::string& err) { return err.find("ubs: warning: ") != std::string::npos; }

class Campaign {
 public:
  Campaign(const TempFolder& folder, const Scenario& scenario) : folder_(folder), scenario_(scenario) {}

  int run(const std::vector<FaultKind>& faults, int most) {
    if (!scenario_.before.empty()) {
      prepare(false);
      REQUIRE(run_command(folder_, command_line(scenario_.before)).code == 0);
      old_ = results();
      fs::copy(folder_ / "out", folder_ / "before", fs::copy_options::recursive);
    }
    for (const FaultKind& fault : faults) seen_ |= fault.calls;
    prepare(true);
    const TracedRun clean = traced({});
    INFO("undisturbed: " << clean.err << to_text(clean.calls));
    REQUIRE(clean.code == 0);
    new_ = results();
    REQUIRE(!new_.empty());
    check_foreign();
    int runs = 0;
    if (scenario_.disk != nullptr) {
      scenario_.disk->cut_power();
      INFO("power cut at the end");
      compare(results());
      check_foreign();
      ++runs;
    }
    for (const FaultKind& fault : faults) {
      const int calls = clean.count(fault.calls);
      const int chosen = whole_sweep() ? calls : std::min(calls, most);
      for (int i = 0; i < chosen; ++i, ++runs) disturb(fault, 1 + (2 * i + 1) * calls / (2 * chosen));
    }
    if (scenario_.disk == nullptr) fs::remove_all(folder_ / "out");
    fs::remove_all(folder_ / "before");
    return runs;
  }

 private:
  void prepare(bool with_old) {
    if (!scenario_.emptied.empty()) fs::remove_all(folder_ / scenario_.emptied);
    if (scenario_.disk != nullptr)
      scenario_.disk->format();
    else
      fs::remove_all(folder_ / "out");
    if (with_old && !scenario_.before.empty())
      fs::copy(folder_ / "before", folder_ / "out", fs::copy_options::recursive);
    for (const char* name : kForeign) put(folder_ / "out" / name, name);
    if (scenario_.disk != nullptr) scenario_.disk->sync();  // the existing files survive a power cut
  }

  std::string command_line(const std::string& arguments) const {
    return fmt::format("env {} '{}' {}", scenario_.environment, program_of(arguments), arguments);
  }

  TracedRun traced(const std::optional<Fault>& fault) {
    return trace_command(folder_, command_line(scenario_.command), folder_ / scenario_.watched, fault, 120,
                         seen_);
  }

  // Returns the files in out/, except foreign and temporary files, lists of outputs and locks.
  Snapshot results() const {
    Snapshot files = snapshot(folder_ / "out");
    for (const char* name : kForeign) files.erase(name);
    std::erase_if(files,
                  [](const auto& file) { return is_temporary(file.first) || is_own_trace(file.first); });
    if (scenario_.common)
      for (auto& [path, bytes] : files) bytes = scenario_.common(path, bytes);
    return files;
  }

  void check_foreign() const {
    for (const char* name : kForeign) CHECK(get(folder_ / "out" / name) == name);
  }

  int temporaries() const {
    int count = 0;
    for (const auto& [path, bytes] : snapshot(folder_ / "out")) count += is_temporary(path);
    return count;
  }

  // Checks that the content of a result is that of the old or of the new result. Checkpoints of an unfinished
  // run differ from both, so they must only be readable.
  void check_whole(const std::string& path, const std::string& bytes) const {
    if (path == "log.csv") return;  // this file grows line by line
    if (!scenario_.unfinished.empty() && path.find(scenario_.unfinished) != std::string::npos) return;
    if (path == "checkpoint.ubs" || path == "continue.ubs") {
      CHECK_NOTHROW(read_checkpoint(folder_ / "out" / path));
      return;
    }
    const auto now = new_.find(path), before = old_.find(path);
    const bool is_new = now != new_.end() && now->second == bytes;
    const bool is_old = before != old_.end() && before->second == bytes;
    if (is_new || is_old) return;
    FAIL_CHECK(path << " of " << bytes.size() << " bytes is neither the old nor the new result");
  }

  void disturb(const FaultKind& kind, int nth) {
    prepare(true);
    const TracedRun run = traced(Fault{kind.calls, nth, kind.action, kind.number, kind.lasting});
    const bool killing = kind.action == Fault::kill_before || kind.action == Fault::kill_after;
    const bool signalled = kind.action == Fault::signal;
    if (kind.power_cut) scenario_.disk->cut_power();
    const Snapshot now = results();
    const bool may_end = signalled && (!scenario_.keeps_at_signal || now == old_ || now == new_);
    INFO("ubs " << scenario_.command << "\n"
                << kind.name << " at call " << nth << ": exit code " << run.code << ", signal " << run.signal
                << "\n"
                << run.err << to_text(run.calls));
    CHECK_FALSE(run.hung);
    check_foreign();
    if (killing && run.struck && run.signal != 0) {
      CHECK(run.signal == SIGKILL);
    } else if (may_end && run.signal != 0) {
      CHECK(run.signal == kind.number);
    } else {
      CHECK(run.signal == 0);
      if (killing && run.struck) CHECK(scenario_.has_children);
      const bool is_documented = std::ranges::find(scenario_.codes, run.code) != scenario_.codes.end();
      CHECK((is_documented || (signalled && run.code == 130)));
      if (run.code != 1) CHECK(error_lines(run.err) == (run.code == 0 || run.code == 130 ? 0 : 1));
      if (run.code == 3) CHECK(run.err.find("std::") == std::string::npos);
      // Temporary files may only remain if a removal fails or the process is killed.
      if ((kind.calls & remove_calls) == 0 && !killing) CHECK(temporaries() == 0);
    }
    // The results of a run that was interrupted by a signal are neither the old nor the new ones. The checks
    // below show that the run can be completed.
    if (!(signalled && run.code == 130))
      for (const auto& [path, bytes] : now) check_whole(path, bytes);
    if (run.code == 0 && now == new_) return;
    if (run.code == 0) CHECK((scenario_.best_effort && warned(run.err)));
    if (run.code == 0) return;
    const std::string more = scenario_.complete ? scenario_.complete(folder_) : scenario_.command;
    const Result completed = run_command(folder_, command_line(more));
    INFO("ubs " << more << ": exit code " << completed.code << "\n" << completed.err);
    CHECK(completed.code == 0);
    compare(results());
    check_foreign();
    CHECK(temporaries() == 0);
  }

  void compare(const Snapshot& now) const {
    for (const auto& [path, bytes] : new_) {
      INFO(path);
      REQUIRE(now.contains(path));
      CHECK((now.at(path) == bytes));
    }
    for (const auto& [path, bytes] : now)
      if (!new_.contains(path) && !old_.contains(path)) FAIL_CHECK(path << ": this file must not exist");
  }

  const TempFolder& folder_;
  const Scenario& scenario_;
  Snapshot old_, new_;
  unsigned seen_ = change_calls | close_calls;
};

}  // namespace

const std::vector<FaultKind>& writing_faults() {
  constexpr unsigned space = open_calls | write_calls | sync_calls | make_calls | resize_calls;
  static const std::vector<FaultKind> kinds{
      {"no space, once", space, Fault::fail, ENOSPC},
      {"no space from this call on", space, Fault::fail, ENOSPC, true},
      {"EIO", write_calls | sync_calls | rename_calls | close_calls | remove_calls, Fault::fail, EIO},
      {"EINTR", open_calls | write_calls | sync_calls | close_calls, Fault::fail, EINTR},
      {"short write", write_calls, Fault::shorten},
      {"EACCES from this call on", open_calls | rename_calls | remove_calls | make_calls, Fault::fail, EACCES,
       true},
      // This happens when the kernel makes a file system read-only after a disk error. Writing to files that
      // are already open fails too.
      {"EROFS from this call on",
       open_calls | write_calls | sync_calls | rename_calls | remove_calls | make_calls | resize_calls,
       Fault::fail, EROFS, true}};
  return kinds;
}

const std::vector<FaultKind>& reading_faults() {
  static const std::vector<FaultKind> kinds{{"EIO", look_calls | read_calls, Fault::fail, EIO},
                                            {"EINTR", look_calls | read_calls, Fault::fail, EINTR},
                                            {"too many open files", look_calls, Fault::fail, EMFILE},
                                            {"short read", read_calls, Fault::shorten}};
  return kinds;
}

const std::vector<FaultKind>& kills() {
  static const std::vector<FaultKind> kinds{{"kill before", change_calls, Fault::kill_before},
                                            {"kill after", change_calls, Fault::kill_after}};
  return kinds;
}

const std::vector<FaultKind>& power_cuts() {
  constexpr unsigned steps = sync_calls | rename_calls | remove_calls | make_calls;
  static const std::vector<FaultKind> kinds{{"power cut before", steps, Fault::kill_before, 0, false, true},
                                            {"power cut after", steps, Fault::kill_after, 0, false, true}};
  return kinds;
}

const std::vector<FaultKind>& signals() {
  static const std::vector<FaultKind> kinds{{"SIGINT", change_calls, Fault::signal, SIGINT},
                                            {"SIGTERM", change_calls, Fault::signal, SIGTERM},
                                            {"SIGHUP", change_calls, Fault::signal, SIGHUP}};
  return kinds;
}

int error_lines(const std::string& err) {
  std::istringstream lines(err);
  int count = 0;
  for (std::string line; std::getline(lines, line);) count += line.starts_with("ubs: error: ");
  return count;
}

int attack(const TempFolder& folder, const std::string& name, const Scenario& scenario,
           const std::vector<FaultKind>& faults, int most) {
  const int runs = Campaign(folder, scenario).run(faults, most);
  fmt::print("{}: {} runs\n", name, runs);
  std::fflush(stdout);
  return runs;
}

}  // namespace ubs::test
