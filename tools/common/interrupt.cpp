// SPDX-License-Identifier: Apache-2.0
#include "tools/common/interrupt.hpp"

#include <unistd.h>

#include <cstdint>
#include <ctime>
#include <string_view>

namespace ubs::tools {
namespace {

constexpr std::array kRequests{SIGINT, SIGTERM, SIGHUP};
// A further signal within these times counts as a part of the same request. Programs such as `timeout` send a
// signal twice, to the process and to its group, and other programs pass a Ctrl-C on to a process that has
// already received it from the terminal.
constexpr std::int64_t kSameCtrlCMs = 500, kSameRequestMs = 2000;

// This must be read when the program starts, because LLVM in OpenCL drivers replaces the handlers later.
const bool hangup_ignored = [] {
  struct sigaction found = {};
  return sigaction(SIGHUP, nullptr, &found) == 0 && found.sa_handler == SIG_IGN;
}();

enum Request : std::sig_atomic_t { kNone, kComplete, kEnd };
volatile std::sig_atomic_t request = kNone, first_completes = 0;
volatile std::int64_t requested_at_ms = 0;
const char* volatile last_line = "";

// This function may only make async-signal-safe calls.
void note(int signal) {
  timespec time = {};
  clock_gettime(CLOCK_MONOTONIC, &time);
  const std::int64_t now_ms = std::int64_t{time.tv_sec} * 1000 + time.tv_nsec / 1'000'000;
  const std::int64_t since_ms = now_ms - requested_at_ms;
  if (request == kNone)
    request = first_completes && signal == SIGINT ? kComplete : kEnd;
  else if (request == kComplete && first_completes && (signal != SIGINT || since_ms >= kSameCtrlCMs))
    request = kEnd;
  else {
    if (since_ms < kSameRequestMs) return;
    std::signal(signal, SIG_DFL);
    raise(signal);
    return;
  }
  requested_at_ms = now_ms;
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

InterruptGuard::InterruptGuard(bool completes) {
  request = kNone;
  first_completes = completes;
  previous_ = handle_requests(note);
}
InterruptGuard::~InterruptGuard() { restore(previous_); }

bool InterruptGuard::interrupted() const { return request != kNone; }
bool InterruptGuard::must_end() const { return request == kEnd; }
void InterruptGuard::loop_ended() { first_completes = 0; }

bool in_foreground() { return ::tcgetpgrp(STDIN_FILENO) == ::getpgrp(); }

}  // namespace ubs::tools
