// SPDX-License-Identifier: Apache-2.0
// DriverWatch prints a message of ubs when an OpenCL driver ends the process. If memory runs out, or if the
// disk with the kernel cache is full, LLVM inside PoCL calls abort() or exit(). It may also throw an
// exception through C code, which leaves its locks held, so that the next call would wait forever. The
// process cannot recover from this. It can only print a message and return the right exit code.
#pragma once

#include <string>

namespace ubs::opencl {

// Disables DriverWatch for the rest of the process. Programs that use ubs as a library need this, because
// they handle the end of the process themselves, and several of their threads may call drivers.
void leave_drivers_alone() noexcept;

// While a DriverWatch exists, such an end of the process is reported with the text `what`, such as the name
// of a kernel. If a thread of the driver ends the process later, this is also reported, without this text.
// The exit code is 6 if memory is limited and used up, 3 if the cache of compiled kernels is not writable,
// and 4 otherwise. `what` must outlive the DriverWatch. If several are nested, the inner one applies. Only
// one thread, the one that calls drivers, may use DriverWatch.
class DriverWatch {
 public:
  explicit DriverWatch(const std::string& what) noexcept;
  ~DriverWatch();
  DriverWatch(const DriverWatch&) = delete;
  DriverWatch& operator=(const DriverWatch&) = delete;

 private:
  const char* outer_;
};

// Calls a driver inside a DriverWatch. An exception from the call ends the process.
template <typename Call>
auto watched(const std::string& what, const Call& call) noexcept {
  const DriverWatch watch(what);
  return call();
}

}  // namespace ubs::opencl
