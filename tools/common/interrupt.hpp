// SPDX-License-Identifier: Apache-2.0
// SIGINT and SIGTERM as a question that a loop asks, while an object of this class lives. A second request,
// two seconds or more later, has the usual effect, so that a stuck process can still be ended.
#pragma once

#include <csignal>

namespace ubs::tools {

class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;

  bool interrupted() const;

 private:
  struct sigaction previous_int_ = {}, previous_term_ = {};
};

inline constexpr int kInterruptedExitCode = 130;

}  // namespace ubs::tools
