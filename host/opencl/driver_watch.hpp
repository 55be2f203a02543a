// SPDX-License-Identifier: Apache-2.0
// DriverWatch prints a message of ubs when an OpenCL driver ends the process. If memory runs out, or the disk
// of its kernel cache is full, LLVM inside PoCL calls abort() or exit(), or throws through C code and leaves
// its locks held, so that the next call would wait forever. The process cannot recover; it can only print a
// message and return the right exit code.
#pragma once

#include <string>

namespace ubs::opencl {

// Disables DriverWatch for the rest of the process. For programs that use the library: they handle the end of
// the process themselves, and several of their threads may call drivers.
void leave_drivers_alone() noexcept;

// While a DriverWatch exists, and later in threads of the driver, such an end of the process is reported with
// `what` ("kernel 'adam_step'"). The exit code is 6 if memory is limited and used up, 3 if the cache of
// compiled kernels is not writable, and 4 otherwise. `what` must outlive the DriverWatch. If they are nested,
// the inner one applies. Only for the one thread that calls drivers.
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
