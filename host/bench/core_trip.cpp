// SPDX-License-Identifier: Apache-2.0
#include "host/bench/core_trip.hpp"

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace ubs::bench {
namespace {

constexpr int kTrips = 200, kRuns = 10;
constexpr int kSpins = 1 << 12;    // between looks at the clock
constexpr double kLongest = 0.01;  // seconds for a pair of cores

std::vector<int> cores_of_process() {
  cpu_set_t set;
  std::vector<int> cores;
  if (sched_getaffinity(0, sizeof set, &set) != 0) return cores;
  for (int core = 0; core < CPU_SETSIZE; ++core)
    if (CPU_ISSET(core, &set)) cores.push_back(core);
  return cores;
}

void run_on(int core) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(core, &set);
  pthread_setaffinity_np(pthread_self(), sizeof set, &set);
}

// Where cores are busy with something else a hand-over takes as long as their scheduler lets others run: the
// time is looked at while one waits, and what was done until then counts.
double round_trip_ns(int first, int second, const TimeSource& time) {
  alignas(64) std::atomic<int> ball{0};
  alignas(64) std::atomic<bool> over{false};
  std::thread answers([&] {
    run_on(second);
    for (int next = 1;; next += 2) {
      while (ball.load(std::memory_order_acquire) != next)
        if (over.load(std::memory_order_relaxed)) return;
      ball.store(next + 1, std::memory_order_release);
    }
  });
  double best = 0;
  std::thread asks([&] {
    run_on(first);
    int sent = 0;
    const double begin = time.seconds();
    const auto late = [&] { return time.seconds() - begin > kLongest; };
    for (int run = 0; run < kRuns && !over; ++run) {
      const double start = time.seconds();
      int trips = 0;
      for (; trips < kTrips && !over; ++trips, sent += 2) {
        ball.store(sent + 1, std::memory_order_release);
        for (int spins = 1; ball.load(std::memory_order_acquire) != sent + 2; ++spins)
          if (spins % kSpins == 0 && late()) {
            over = true;
            break;
          }
      }
      const double ns = 1e9 * (time.seconds() - start) / std::max(1, trips);
      best = best > 0 ? std::min(best, ns) : ns;
      if (late()) over = true;
    }
    over = true;
  });
  asks.join();
  answers.join();
  return best;
}

}  // namespace

double core_round_trip_ns(const TimeSource& time) {
  const std::vector<int> cores = cores_of_process();
  double farthest = 0;
  for (std::size_t i = 1; i < cores.size(); ++i)
    farthest = std::max(farthest, round_trip_ns(cores.front(), cores[i], time));
  return farthest;
}

}  // namespace ubs::bench
