// SPDX-License-Identifier: Apache-2.0
#include "tools/common/interrupt.hpp"

#include <unistd.h>

#include <ctime>
#include <string_view>

namespace ubs::tools {
namespace {

constexpr std::array kRequests{SIGINT, SIGTERM, SIGHUP};
// Programs such as `timeout` send the same signal twice, to the process and to its group.
constexpr std::time_t kSameRequestSeconds = 2;

// This must be read when the program starts, because LLVM in OpenCL drivers replaces the handlers later.
const bool hangup_ignored = [] {
  struct sigaction found = {};
  return sigaction(SIGHUP, nullptr, &found) == 0 && found.sa_handler == SIG_IGN;
}();

volatile std::sig_atomic_t received = 0;
volatile std::time_t received_at = 0;
const char* volatile last_line = "";

// This function may only make async-signal-safe calls.
void note(int signal) {
  const std::time_t now = std::time(nullptr);
  if (received && now - received_at >= kSameRequestSeconds) {
    std::signal(signal, SIG_DFL);
    raise(signal);
    return;
  }
  if (!received) received_at = now;
  received = 1;
}

void end(int) {
  const std::string_view line = last_line;
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, line.data(), line.size());
  ::_exit(kInterruptedExitCode);
}

using Actions = std::array<struct sigaction, kRequests.size()>;

Actions handle_requests(void (*handler)(int)) {
  Actions previous = {};
  struct sigaction action = {};
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  for (std::size_t i = 0; i < kRequests.size(); ++i) {
    action.sa_handler = kRequests[i] == SIGHUP && hangup_ignored ? SIG_IGN : handler;
    sigaction(kRequests[i], &action, &previous[i]);
  }
  return previous;
}

void restore(const Actions& previous) {
  for (std::size_t i = 0; i < kRequests.size(); ++i) sigaction(kRequests[i], &previous[i], nullptr);
}

}  // namespace

EndOnRequest::EndOnRequest(const char* line) {
  last_line = line;
  previous_ = handle_requests(end);
}
EndOnRequest::~EndOnRequest() { restore(previous_); }

InterruptGuard::InterruptGuard() {
  received = 0;
  previous_ = handle_requests(note);
}
InterruptGuard::~InterruptGuard() { restore(previous_); }

bool InterruptGuard::interrupted() const { return received != 0; }

bool in_foreground() { return ::tcgetpgrp(STDIN_FILENO) == ::getpgrp(); }

}  // namespace ubs::tools
