// SPDX-License-Identifier: Apache-2.0
// Test support: introduces faults at system calls of a command on the files of one folder, and checks the
// following after each fault. The exit code is documented and not "internal". An error message is one line.
// The command does not hang. Each result is the old file, the complete new file, or missing. Files that ubs
// did not write are unchanged. Temporary files only remain if the process was killed or could not remove
// them. If the exit code is 0 and there is no warning, the results are bit-identical to those of an
// undisturbed run. Otherwise, the test runs a command that completes the work on a working disk. Its results
// must be bit-identical to those of an undisturbed run, and it must leave no temporary file.
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
  std::string before = {};          // arguments of a run that creates older results; empty: no such run
  std::string watched = "out";      // folder; faults are introduced at calls on its files
  std::string environment = {};     // environment variable of the command, as "NAME=value"; may be empty
  std::string emptied = {};         // folder that is deleted before every run; may be empty
  std::vector<int> codes = {0, 3};  // exit codes that faults may cause
  // Files whose path contains this text are only checked after the work has been completed, because they may
  // be incomplete before. If the text is empty, all files are checked.
  std::string unfinished = {};
  bool has_children = false;  // the command starts processes, and continues if one of them is killed
  // If this is true, a signal must not kill the command between the first and the last change of a result.
  // The command must end by itself, with an exit code.
  bool keeps_at_signal = false;
  bool best_effort = false;  // the command may end with code 0 and a warning if it cannot write a result
  // Returns the arguments of the command that completes the work after a fault. The parameter is the folder
  // in which the command ran. If the function is empty, the command is repeated.
  std::function<std::string(const TempFolder&)> complete = {};
  LoopDisk* disk = nullptr;  // disk that is mounted at out/; may be null
  // Returns a string that must be equal for the files of two runs, for example the file without its times. If
  // the function is empty, all bytes must be equal.
  std::function<std::string(const std::string& path, const std::string& bytes)> common = {};
};

// FaultKind describes a kind of fault, and the kinds of calls (bits of CallKind) at which it is introduced.
// The comments of Fault describe action, number and lasting.
struct FaultKind {
  const char* name;
  unsigned calls;
  Fault::Action action;
  int number = 0;
  bool lasting = false;
  // After the process was killed, data that were not synchronised are also lost. This requires a
  // Scenario::disk.
  bool power_cut = false;
};

// Returns faults of writing: a full, broken or read-only disk, EINTR, short writes, and missing permissions.
const std::vector<FaultKind>& writing_faults();
const std::vector<FaultKind>& reading_faults();
const std::vector<FaultKind>& kills();
const std::vector<FaultKind>& power_cuts();
const std::vector<FaultKind>& signals();

// Returns the number of error lines of ubs on stderr. Other lines are warnings, progress, or messages of
// libraries.
int error_lines(const std::string& err);

// Runs the command of the scenario with faults. `folder` contains the inputs. For each kind of fault, the
// command runs at most `most` times, with the fault at calls that are spread evenly. With UBS_TEST_ALL=1, it
// runs for every call. Returns the number of runs, and prints it with the name of the scenario.
int attack(const TempFolder& folder, const std::string& name, const Scenario& scenario,
           const std::vector<FaultKind>& faults, int most);

}  // namespace ubs::test
