// SPDX-License-Identifier: Apache-2.0
// A line of ours where a driver ends the process. Short of memory, or of disk for its kernel cache, LLVM
// inside of PoCL calls abort() or exit(), or throws through C code and leaves its locks taken, so that the
// next call would wait for ever. Nobody can go on from there; what can be had is a message and the right exit
// code.
#pragma once

#include <string>

namespace ubs::opencl {

// Off for ever, in programs that use the library: their end is their own matter, and several of their threads may
// call drivers.
void leave_drivers_alone() noexcept;

// While one lives, and later in threads of the driver, such an end is reported with `what` ("kernel
// 'adam_step'") and has exit code 6 where memory is limited and spent, 3 where the cache of compiled kernels
// cannot be written, else 4. `what` must outlive it. Nested ones: the inner counts. For the one thread that
// calls drivers.
class DriverWatch {
 public:
  explicit DriverWatch(const std::string& what) noexcept;
  ~DriverWatch();
  DriverWatch(const DriverWatch&) = delete;
  DriverWatch& operator=(const DriverWatch&) = delete;

 private:
  const char* outer_;
};

// Calls a driver under watch. What it throws ends the process.
template <typename Call>
auto watched(const std::string& what, const Call& call) noexcept {
  const DriverWatch watch(what);
  return call();
}

}  // namespace ubs::opencl
