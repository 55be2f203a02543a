// SPDX-License-Identifier: Apache-2.0
// parallel_for() runs a loop over independent items on all cores. Each item must write only its own results,
// so that the outcome does not depend on the number of threads. If several items fail, the exception of the
// one with the lowest index is thrown.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

namespace ubs {

template <typename Function>
void parallel_for(std::size_t count, const Function& function) {
  std::atomic<std::size_t> next{0};
  std::vector<std::exception_ptr> errors(count);
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        function(i);
      } catch (...) {
        errors[i] = std::current_exception();
      }
    }
  };
  {
    // At least two threads, so that reading files overlaps with decoding even if only one core is reported.
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
