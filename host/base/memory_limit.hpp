// SPDX-License-Identifier: Apache-2.0
// How much memory the system lets this process have, where that is less than the machine has: containers and
// batch systems limit groups of processes, and end without a word what goes beyond.
#pragma once

#include <cstdint>
#include <filesystem>

namespace ubs {

// The least limit of the control groups (version 1 and 2) that the process is in [bytes]; the largest number
// where there is none. `root`: of the file system, for tests.
std::uint64_t memory_limit(const std::filesystem::path& root = "/");

// What is left of memory_limit() for the buffers of a device that has its memory from the system: without
// what the process already holds and what the device's compiler needs.
std::uint64_t memory_left();

}  // namespace ubs
