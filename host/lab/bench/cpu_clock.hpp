// SPDX-License-Identifier: Apache-2.0
// cpu_ms() measures the processor time of this process. On a CPU device this shows the cost of a stage even
// if other processes use the same cores and lengthen the wall time.
#pragma once

#include <sys/resource.h>

namespace ubs::bench {

// Returns the user and system time of all threads so far [ms].
inline double cpu_ms() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto ms = [](const timeval& t) {
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_usec);
  };
  return ms(usage.ru_utime) + ms(usage.ru_stime);
}

}  // namespace ubs::bench
