// SPDX-License-Identifier: Apache-2.0
// parallel_for() calls function(0) to function(count - 1) on all cores. Each call must write only its own
// results, so that the outcome does not depend on the number of threads. If several calls throw an exception,
// the exception of the call with the lowest index is thrown again. If the calling thread is asked to stop
// (stop_request.hpp), the remaining calls are skipped, and Stopped is thrown.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

#include "host/base/stop_request.hpp"

namespace ubs {

template <typename Function>
void parallel_for(std::size_t count, const Function& function) {
  std::atomic<std::size_t> next{0};
  std::vector<std::exception_ptr> errors(count);
  const auto work = [&, flag = stop_flag] {
    stop_flag = flag;
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        check_stop();
        function(i);
      } catch (...) {
        errors[i] = std::current_exception();
      }
    }
  };
  {
    // At least two threads are used, so that reading files overlaps with decoding even on a single core.
    const std::size_t threads =
        std::min<std::size_t>(count, std::max(2u, std::thread::hardware_concurrency()));
    std::vector<std::jthread> workers;
    for (std::size_t i = 1; i < threads; ++i) workers.emplace_back(work);
    work();
  }
  for (const auto& error : errors)
    if (error) std::rethrow_exception(error);
}

}  // namespace ubs
