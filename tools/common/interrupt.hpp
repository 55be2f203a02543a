// SPDX-License-Identifier: Apache-2.0
// InterruptGuard lets a loop end cleanly. While the object exists, the signals SIGINT, SIGTERM and SIGHUP
// (closed terminal) only set a state that the loop can query. After a request to end, a signal that comes two
// seconds or more later has its usual effect, so that a stuck process can still be ended. If SIGHUP is
// ignored (nohup), it stays ignored.
#pragma once

#include <array>
#include <csignal>

namespace ubs::tools {

class InterruptGuard {
 public:
  // The first Ctrl-C (SIGINT) of a loop that `completes` only asks it to complete its work soon. A second one
  // or another signal asks it to end.
  explicit InterruptGuard(bool completes = false);
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;

  // Returns whether any signal has come.
  bool interrupted() const;
  // Returns whether the loop must end now.
  bool must_end() const;
  // Must be called when the loop has ended. A Ctrl-C that comes two seconds or more after an earlier one
  // then has its usual effect.
  void loop_ended();

 private:
  std::array<struct sigaction, 3> previous_ = {};
};

// While an object of this class exists, any of these signals ends the program immediately, with a message and
// kInterruptedExitCode. It is used for work that writes no files.
class EndOnRequest {
 public:
  // `line` is printed to stderr. It must exist until the program ends, like a string literal.
  explicit EndOnRequest(const char* line);
  ~EndOnRequest();
  EndOnRequest(const EndOnRequest&) = delete;

 private:
  std::array<struct sigaction, 3> previous_ = {};
};

// Returns whether this process is in the foreground of a terminal, so that the user can end it with Ctrl-C.
// Returns false if it runs in a batch job, in the background, or with an input that is not the terminal.
bool in_foreground();

inline constexpr int kInterruptedExitCode = 130;

}  // namespace ubs::tools
