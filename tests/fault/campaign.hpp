// SPDX-License-Identifier: Apache-2.0
// Test support: every fault at every system call of a command, and what must hold after each of them:
//   the exit code is documented and not "internal"; an error is one line; nothing hangs;
//   what is there is the old file, or the complete new one, or nothing; foreign files are as they were; of
//     temporary files only a killed process leaves some;
//   exit code 0 without a warning means results with the bits of an undisturbed run;
//   otherwise the command that completes the work, on a disk that works again, leaves those bits and no
//     temporary file.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tests/fault/loop_disk.hpp"
#include "tests/fault/traced_run.hpp"

namespace ubs::test {

using Snapshot = std::map<std::string, std::string>;  // path below the folder, content

struct Scenario {
  std::string command;              // arguments of ubs; its results are below out/
  std::string before = {};          // arguments of a run that leaves older results there; empty: none
  std::string watched = "out";      // folder whose calls are disturbed
  std::string environment = {};     // "NAME=value", for env
  std::string emptied = {};         // folder that is deleted before every run; may be none
  std::vector<int> codes = {0, 3};  // exit codes that faults may have
  // Files whose path holds this are work in progress: nothing is promised of them before the work is
  // completed.
  std::string unfinished = {};
  bool has_children = false;     // processes that can be killed while the command goes on
  bool keeps_at_signal = false;  // a signal ends it in order from the first change of a result to the last
  bool best_effort = false;      // may end with 0 and a warning where a result is missing
  // Arguments that finish the work after `run`; empty function: the command again.
  std::function<std::string(const TempFolder&)> complete = {};
  LoopDisk* disk = nullptr;  // that is mounted at out/; may be none
  // What two runs have in common of a file; empty function: all bytes.
  std::function<std::string(const std::string& path, const std::string& bytes)> common = {};
};

struct FaultKind {
  const char* name;
  unsigned calls;
  Fault::Action action;
  int number = 0;
  bool lasting = false;
  bool power_cut = false;  // with a kill: what was not synchronised is lost too. Needs a disk
};

// A full disk, a broken one, EINTR, short writes, no permission.
const std::vector<FaultKind>& writing_faults();
const std::vector<FaultKind>& reading_faults();
const std::vector<FaultKind>& kills();
const std::vector<FaultKind>& power_cuts();
const std::vector<FaultKind>& signals();

// Errors of ours on stderr; other lines are warnings, progress, or what a library says.
int error_lines(const std::string& err);

// The folder has the inputs. At most `most` runs of each kind of fault, spread evenly over the calls; all of
// them with UBS_TEST_ALL=1. Returns the number of runs, which it prints with the scenario's name.
int attack(const TempFolder& folder, const std::string& name, const Scenario& scenario,
           const std::vector<FaultKind>& faults, int most);

}  // namespace ubs::test
