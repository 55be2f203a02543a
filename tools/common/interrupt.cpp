// SPDX-License-Identifier: Apache-2.0
#include "tools/common/interrupt.hpp"

#include <unistd.h>

#include <atomic>
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

// Threads of OpenCL drivers do not block signals. So the handlers can run in any thread, and in two threads
// at the same time, for example if a signal comes while the main thread handles another one. Signal handlers
// may use atomic objects that are lock-free.
enum Request : std::int64_t { kNone, kComplete, kEnd };
std::atomic<std::int64_t> last_request = kNone;  // 4 * time [ms] + Request: both change together
std::atomic<bool> first_completes = false;
std::atomic<const char*> last_line = "";
static_assert(decltype(last_request)::is_always_lock_free && decltype(first_completes)::is_always_lock_free &&
              decltype(last_line)::is_always_lock_free);

Request kind_of(std::int64_t value) { return static_cast<Request>(value % 4); }

// This function may only make async-signal-safe calls.
void note(int signal) {
  timespec time = {};
  clock_gettime(CLOCK_MONOTONIC, &time);
  const std::int64_t now_ms = std::int64_t{time.tv_sec} * 1000 + time.tv_nsec / 1'000'000;
  std::int64_t earlier = last_request;
  Request next = kNone;
  do {
    const std::int64_t since_ms = now_ms - earlier / 4;
    if (kind_of(earlier) == kNone)
      next = first_completes && signal == SIGINT ? kComplete : kEnd;
    else if (kind_of(earlier) == kComplete && first_completes &&
             (signal != SIGINT || since_ms >= kSameCtrlCMs))
      next = kEnd;
    else {
      if (since_ms < kSameRequestMs) return;
      std::signal(signal, SIG_DFL);
      raise(signal);
      return;
    }
  } while (!last_request.compare_exchange_weak(earlier, 4 * now_ms + next));
}

void end(int) {
  const std::string_view line = last_line.load();
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
  last_request = kNone;
  first_completes = completes;
  previous_ = handle_requests(note);
}
InterruptGuard::~InterruptGuard() { restore(previous_); }

bool InterruptGuard::interrupted() const { return kind_of(last_request) != kNone; }
bool InterruptGuard::must_end() const { return kind_of(last_request) == kEnd; }
void InterruptGuard::loop_ended() { first_completes = false; }

bool in_foreground() { return ::tcgetpgrp(STDIN_FILENO) == ::getpgrp(); }

}  // namespace ubs::tools
