// SPDX-License-Identifier: Apache-2.0
#include "host/base/memory_limit.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <latch>
#include <string>
#include <thread>
#include <vector>

#include "host/base/error.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMebibyte = std::uint64_t{1} << 20;
// Memory and address space that an OpenCL driver still allocates after the devices have been listed, in
// addition to large buffers. They were measured with PoCL 3.1 and LLVM 14 (x86-64, two cores). If the driver
// compiles the kernels for N = 7, it allocates 206 MiB of private memory. If it loads them from the cache, it
// allocates 25 MiB. It also needs 87 MiB of address space.
constexpr std::uint64_t kDriverBytes = 240 * kMebibyte, kDriverAddresses = 128 * kMebibyte;
// Address space that an OpenCL driver needs for its libraries and threads. If 264 MiB of address space are
// left, PoCL lists no device; if 314 MiB are left, it lists its devices.
constexpr std::uint64_t kDriverLibraries = 320 * kMebibyte;

// Returns the smallest limit of a control group and of the groups above it. A group has no limit if `file` is
// missing, or contains the word "max". In version 1 of control groups, the number 2^63 minus one page also
// means that there is no limit. In a container, the names of the groups may be those outside of the
// container. In this case, the root of the hierarchy in the container is the group of the container.
std::uint64_t least_limit(const fs::path& hierarchy, fs::path group, const char* file) {
  std::uint64_t least = kNoMemoryLimit;
  for (;; group = group.parent_path()) {
    std::uint64_t limit = 0;
    if (std::ifstream(hierarchy / group / file) >> limit && limit < std::uint64_t{1} << 62)
      least = std::min(least, limit);
    if (!group.has_relative_path()) return least;
  }
}

// Returns the private memory that this process occupies.
std::uint64_t resident_bytes() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    std::uint64_t kib = 0;
    if (word == "RssAnon:" && status >> kib) return kib << 10;
  }
  return 0;
}

// Returns a number of memory pages of this process from /proc/self/statm. Column 0 is the total number, and
// column 5 is the number of pages for data and stack.
std::uint64_t pages(std::size_t column) noexcept {
  char text[256] = {};
  const int file = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  if (file < 0) return 0;
  const ssize_t size = ::read(file, text, sizeof text - 1);
  ::close(file);
  if (size <= 0) return 0;
  char* at = text;
  std::uint64_t value = 0;
  for (std::size_t i = 0; i <= column; ++i) value = std::strtoull(at, &at, 10);
  return value;
}

struct ProcessLimit {
  int resource;
  std::size_t column;  // column of /proc/self/statm
  const char* name;
};
constexpr std::array kProcessLimits{ProcessLimit{RLIMIT_AS, 0, "address space, ulimit -v"},
                                    ProcessLimit{RLIMIT_DATA, 5, "data, ulimit -d"}};

MemoryRoom room_of(const ProcessLimit& which) noexcept {
  rlimit limit{};
  if (::getrlimit(static_cast<__rlimit_resource>(which.resource), &limit) != 0 ||
      limit.rlim_cur == RLIM_INFINITY)
    return {};
  const std::uint64_t used = pages(which.column) * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  return {limit.rlim_cur, limit.rlim_cur > used ? limit.rlim_cur - used : 0, which.name};
}

// Returns from - taken, or 0 if this would be negative.
std::uint64_t less(std::uint64_t from, std::uint64_t taken) { return from > taken ? from - taken : 0; }

// Throws Error(memory) if the process cannot create `count` further threads that run at the same time.
void check_threads(unsigned count) {
  std::latch all(1);
  std::vector<std::jthread> threads;
  try {
    for (unsigned i = 0; i < count; ++i) threads.emplace_back([&] { all.wait(); });
  } catch (const std::exception& error) {
    all.count_down();
    throw as_error(error);
  }
  all.count_down();
}

}  // namespace

std::uint64_t memory_limit(const fs::path& root) {
  std::uint64_t least = kNoMemoryLimit;
  std::ifstream groups(root / "proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {  // each line is "number:controllers:/group"
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

MemoryRoom process_memory() noexcept {
  MemoryRoom least;
  for (const ProcessLimit& which : kProcessLimits)
    if (const MemoryRoom room = room_of(which); room.left < least.left) least = room;
  return least;
}

std::uint64_t memory_left() {
  const std::uint64_t limit = memory_limit(), addresses = process_memory().left;
  return std::min(limit == kNoMemoryLimit ? limit : less(limit, resident_bytes() + kDriverBytes),
                  addresses == kNoMemoryLimit ? addresses : less(addresses, kDriverAddresses));
}

std::uint64_t memory_available() {
  std::uint64_t available = memory_limit();
  if (available != kNoMemoryLimit) available = less(available, resident_bytes());
  available = std::min(available, process_memory().left);
  std::ifstream lines("/proc/meminfo");
  for (std::string word; lines >> word;) {
    std::uint64_t kib = 0;
    if (word == "MemAvailable:" && lines >> kib) return std::min(available, kib << 10);
  }
  return available;
}

void require_memory(std::uint64_t bytes, const std::string& what) {
  if (const std::uint64_t available = memory_available(); bytes > available)
    fail(ErrorKind::memory, "{} needs {:.0f} MiB of memory, but only {:.0f} MiB are available{}", what,
         mib(bytes), mib(available), memory_limits_text());
}

void check_driver_fits() {
  const MemoryRoom room = room_of(kProcessLimits[0]);
  if (room.left < kDriverLibraries)
    fail(ErrorKind::memory,
         "an OpenCL driver needs about {} MiB of address space, but the limit of {} MiB ({}) leaves only {} "
         "MiB: raise the limit",
         kDriverLibraries / kMebibyte, room.limit / kMebibyte, room.name, room.left / kMebibyte);
  // PoCL creates a thread for each core, and starts another process to link kernels. If it cannot create a
  // thread, it ends the program, so the number of threads is checked before.
  check_threads(std::thread::hardware_concurrency() + 1);
}

std::string memory_limits_text() {
  std::string text;
  const auto add = [&](const char* name, std::uint64_t bytes) {
    if (bytes != kNoMemoryLimit)
      text += fmt::format("{} {} MiB ({})", text.empty() ? "; limits:" : ",", bytes / kMebibyte, name);
  };
  add("control group", memory_limit());
  for (const ProcessLimit& which : kProcessLimits) add(which.name, room_of(which).limit);
  return text;
}

}  // namespace ubs
