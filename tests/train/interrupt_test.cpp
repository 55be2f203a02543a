// SPDX-License-Identifier: Apache-2.0
// Signals can come in a thread of an OpenCL driver, and in two threads at the same time. This must count as
// one request, which neither ends the process nor is lost.
#include "tools/common/interrupt.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <csignal>
#include <thread>
#include <utility>

namespace ubs::tools {
namespace {

// Raises one signal in each of two threads at the same time, and returns how the process ends. Each round
// needs a new process, because only the first request of a process has no earlier one with a time.
int end_of_round(int one, int other) {
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    const InterruptGuard guard(true);
    std::atomic<int> ready{0};
    const auto work = [&](int signal) {
      for (++ready; ready < 2;) {
      }
      std::raise(signal);
    };
    std::thread second(work, other);
    work(one);
    while (!guard.interrupted()) {  // before a join() orders the accesses of the threads
    }
    second.join();
    const bool completes = one == SIGINT && other == SIGINT;
    ::_exit(guard.must_end() != completes ? 0 : 1);
  }
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  return status;
}

TEST_CASE("signals in two threads at the same time are one request") {
  for (int round = 0; round < 100; ++round)
    for (const auto& [one, other] : {std::pair{SIGTERM, SIGTERM}, {SIGINT, SIGINT}, {SIGTERM, SIGINT}})
      REQUIRE(end_of_round(one, other) == 0);
}

}  // namespace
}  // namespace ubs::tools
