// SPDX-License-Identifier: Apache-2.0
// Processor time of this process. On a CPU device it tells what a stage costs even while other processes
// take turns on the same cores and stretch the wall time.
#pragma once

#include <sys/resource.h>

namespace ubs::bench {

// User and system time of all threads so far [ms].
inline double cpu_ms() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto ms = [](const timeval& t) {
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_usec);
  };
  return ms(usage.ru_utime) + ms(usage.ru_stime);
}

}  // namespace ubs::bench
