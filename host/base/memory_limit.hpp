// SPDX-License-Identifier: Apache-2.0
// These functions determine how much memory this process may use, which can be less than the machine has.
// Containers and batch systems limit the memory of a group of processes. If the group exceeds the limit, its
// processes are killed without a message. `ulimit` limits the address space or the data of a process.
// Allocations that exceed such a limit fail, including those of drivers.
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

// Returns the smallest memory limit [bytes] of the control groups (version 1 and 2) that the process belongs
// to, or kNoMemoryLimit if there is none. `root` is the root of the file system; tests pass another folder.
std::uint64_t memory_limit(const std::filesystem::path& root = "/");

// MemoryRoom describes a limit of the process itself (RLIMIT_AS or RLIMIT_DATA), and the memory that it
// leaves.
struct MemoryRoom {
  std::uint64_t limit = kNoMemoryLimit, left = kNoMemoryLimit;     // bytes
  const char* name = "no limit";                                   // for example "address space, ulimit -v"
  bool scarce() const { return left < std::uint64_t{128} << 20; }  // too little for a compiler
};
// Returns the limit of the process that leaves the least memory. This function is async-signal-safe.
MemoryRoom process_memory() noexcept;

// Returns the memory [bytes] that the limits leave for the buffers of a device. The device must be open, and
// use the memory of the machine. The memory that the process already uses, and the memory that the compiler
// of the device needs, are subtracted.
std::uint64_t memory_left();

// Returns the memory [bytes] that this process can still allocate for data other than device buffers, so that
// the machine does not swap and no limit is exceeded.
std::uint64_t memory_available();

// Throws Error(memory) if `bytes` exceeds memory_available(). The message starts with `what` and contains
// both numbers. Callers use this function for sizes that they read from a file, before they allocate memory.
void require_memory(std::uint64_t bytes, const std::string& what);

// Throws Error(memory) if the limits of the process leave too little address space or too few threads for an
// OpenCL driver.
void check_driver_fits();

// Returns a string that lists all limits. It is meant for the end of a message, for example "; limits: 512
// MiB (control group), 900 MiB (address space, ulimit -v)". Returns an empty string if there are no limits.
std::string memory_limits_text();

}  // namespace ubs
