// SPDX-License-Identifier: Apache-2.0
// Determines how much memory this process may use if the system allows less than the machine has. Containers
// and batch systems limit groups of processes, and kill processes that exceed the limit without a message.
// `ulimit` limits the address space or the data of a process; allocations beyond that limit fail, also those
// of drivers.
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

// Returns the smallest limit of the control groups (version 1 and 2) that the process belongs to [bytes], or
// kNoMemoryLimit if there is none. root: root of the file system, for tests.
std::uint64_t memory_limit(const std::filesystem::path& root = "/");

// The limit of the process itself (RLIMIT_AS, RLIMIT_DATA) that leaves the least memory, and how much it
// leaves.
struct MemoryRoom {
  std::uint64_t limit = kNoMemoryLimit, left = kNoMemoryLimit;     // bytes
  const char* name = "no limit";                                   // "address space, ulimit -v"
  bool scarce() const { return left < std::uint64_t{128} << 20; }  // too little for a compiler
};
// Async-signal-safe.
MemoryRoom process_memory() noexcept;

// Returns how much memory all limits leave for the buffers of a device that uses system memory, once it is
// open. The memory that the process already uses, and that the device's compiler needs, is subtracted.
std::uint64_t memory_left();

// Returns how much memory the machine and all limits can provide without swapping, for data other than device
// buffers.
std::uint64_t memory_available();

// Throws Error(memory) if `bytes` exceeds memory_available(). The message starts with `what` and contains the
// numbers. This function is for sizes that are read from a file.
void require_memory(std::uint64_t bytes, const std::string& what);

// Throws Error(memory) if the limits of the process leave too little memory, or too few threads, for an
// OpenCL driver.
void check_driver_fits();

// Returns for example "; limits: control group 512 MiB, address space (ulimit -v) 900 MiB", or an empty
// string without limits.
std::string memory_limits_text();

}  // namespace ubs
