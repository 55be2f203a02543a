// SPDX-License-Identifier: Apache-2.0
#include "host/base/memory_limit.hpp"

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

#include <fmt/format.h>

namespace ubs {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();
// A run of 150 splats holds 270 MiB at most with kernels from the cache, of which 70 when devices are listed
// (PoCL 3.1, x86-64).
constexpr std::uint64_t kDriverBytes = std::uint64_t{200} << 20;

// The limits of a group and of those above it; "max" and files that are not there are none. In a container
// the names may be those outside of it: its own group is then the root that it sees.
std::uint64_t least_limit(const fs::path& hierarchy, fs::path group, const char* file) {
  std::uint64_t least = kNone;
  for (;; group = group.parent_path()) {
    std::uint64_t limit = 0;
    if (std::ifstream(hierarchy / group / file) >> limit) least = std::min(least, limit);
    if (!group.has_relative_path()) return least;
  }
}

std::uint64_t resident_bytes() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    std::uint64_t kib = 0;
    if (word == "RssAnon:" && status >> kib) return kib << 10;
  }
  return 0;
}

}  // namespace

std::uint64_t memory_limit(const fs::path& root) {
  std::uint64_t least = kNone;
  std::ifstream groups(root / "proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {  // "number:controllers:/group"
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = fmt::format(",{},", line.substr(first + 1, second - first - 1));
    const fs::path group = fs::path(line.substr(second + 1)).relative_path();
    if (controllers == ",,")
      least = std::min(least, least_limit(root / "sys/fs/cgroup", group, "memory.max"));
    else if (controllers.find(",memory,") != std::string::npos)
      least = std::min(least, least_limit(root / "sys/fs/cgroup/memory", group, "memory.limit_in_bytes"));
  }
  return least;
}

std::uint64_t memory_left() {
  const std::uint64_t limit = memory_limit();
  if (limit == kNone) return kNone;
  const std::uint64_t taken = resident_bytes() + kDriverBytes;
  return limit > taken ? limit - taken : 0;
}

}  // namespace ubs
