// SPDX-License-Identifier: Apache-2.0
// How much memory the system lets this process have, where that is less than the machine has: containers and
// batch systems limit groups of processes, and end without a word what goes beyond; `ulimit` limits the
// address space or the data of a process, beyond which allocations fail, in drivers too.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>

namespace ubs {

inline constexpr double kMiB = 1 << 20;  // [bytes]
inline double mib(std::uint64_t bytes) { return static_cast<double>(bytes) / kMiB; }
inline double gib(std::uint64_t bytes) { return mib(bytes) / 1024; }

inline constexpr std::uint64_t kNoMemoryLimit = std::numeric_limits<std::uint64_t>::max();

// The least limit of the control groups (version 1 and 2) that the process is in [bytes]; kNoMemoryLimit
// where there is none. `root`: of the file system, for tests.
std::uint64_t memory_limit(const std::filesystem::path& root = "/");

// What the limits of the process itself (RLIMIT_AS, RLIMIT_DATA) leave, of the one that leaves least.
struct MemoryRoom {
  std::uint64_t limit = kNoMemoryLimit, left = kNoMemoryLimit;     // bytes
  const char* name = "no limit";                                   // "address space, ulimit -v"
  bool scarce() const { return left < std::uint64_t{128} << 20; }  // too little for a compiler
};
// Async-signal-safe.
MemoryRoom process_memory() noexcept;

// What all limits leave for the buffers of a device that has its memory from the system, once it is open:
// without what the process already holds and what the device's compiler needs.
std::uint64_t memory_left();

// What the machine and all limits can give without swapping, for what is no buffer of a device.
std::uint64_t memory_available();

// Throws Error(memory) that starts with `what`, with the numbers, where more bytes are wanted than
// memory_available() has. For sizes that a file states.
void require_memory(std::uint64_t bytes, const std::string& what);

// Throws Error(memory) where the process's limits leave no room for an OpenCL driver.
void check_driver_fits();

// "; limits: control group 512 MiB, address space (ulimit -v) 900 MiB"; empty without limits.
std::string memory_limits_text();

}  // namespace ubs
