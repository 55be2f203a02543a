// SPDX-License-Identifier: Apache-2.0
// SIGINT, SIGTERM and SIGHUP (a terminal that was closed) as a question that a loop asks, while an object of
// this class lives. A second request, two seconds or more later, has the usual effect, so that a stuck
// process can still be ended. Where SIGHUP is ignored (nohup) it stays so.
#pragma once

#include <array>
#include <csignal>

namespace ubs::tools {

class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;

  bool interrupted() const;

 private:
  std::array<struct sigaction, 3> previous_ = {};
};

// While it lives such a request ends the program at once, with a line and kInterruptedExitCode: for work that
// leaves nothing behind.
class EndOnRequest {
 public:
  // `line` is printed on stderr. It must outlive the program, as a literal does.
  explicit EndOnRequest(const char* line);
  ~EndOnRequest();
  EndOnRequest(const EndOnRequest&) = delete;

 private:
  std::array<struct sigaction, 3> previous_ = {};
};

inline constexpr int kInterruptedExitCode = 130;

}  // namespace ubs::tools
