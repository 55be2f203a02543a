// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/driver_watch.hpp"

#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <mutex>

#include "host/base/cache_folder.hpp"
#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"

namespace ubs::opencl {
namespace {

std::atomic<const char*> watched_now{nullptr};

// Without locks and the heap, either of which the driver may have left in any state.
[[noreturn]] void end(const char* text, ErrorKind kind) {
  char line[512];
  const int length = std::snprintf(line, sizeof line, "ubs: error: %s\n", text);
  const auto size = static_cast<std::size_t>(length);
  [[maybe_unused]] const auto written =
      ::write(STDERR_FILENO, line, size < sizeof line ? size : sizeof line - 1);
  ::_exit(exit_code(kind));
}

void aborted(int signal) {
  char text[400];
  const char* what = watched_now.load();
  if (const MemoryRoom room = process_memory(); room.scarce()) {
    std::snprintf(
        text, sizeof text,
        "out of memory in the OpenCL driver (%s): %llu of %llu MiB are left (%s); raise the limit, or "
        "use fewer splats or smaller images",
        what ? what : "at work", static_cast<unsigned long long>(room.left >> 20),
        static_cast<unsigned long long>(room.limit >> 20), room.name);
    end(text, ErrorKind::memory);
  }
  if (what) {
    std::snprintf(text, sizeof text,
                  "the OpenCL driver has aborted (%s), for the reason above if it gave one", what);
    end(text, ErrorKind::device);
  }
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

// Reached inside of a driver's call only if the driver has called exit().
void left() {
  const char* what = watched_now.load();
  if (!what) return;
  char text[400];
  const char* folder = std::getenv("POCL_CACHE_DIR");
  if (const std::string defect = folder ? cache_defect(folder) : std::string(); !defect.empty()) {
    std::snprintf(
        text, sizeof text,
        "the OpenCL driver cannot keep compiled kernels in %s (%s); make room, or name another folder "
        "with UBS_KERNEL_CACHE",
        folder, defect.c_str());
    end(text, ErrorKind::data);
  }
  std::snprintf(text, sizeof text, "the OpenCL driver has ended the program (%s), for the reason above",
                what);
  end(text, ErrorKind::device);
}

void install() {
  std::signal(SIGABRT, aborted);
  std::atexit(left);
}

}  // namespace

DriverWatch::DriverWatch(const std::string& what) noexcept : outer_(watched_now.load()) {
  static std::once_flag once;
  std::call_once(once, install);
  watched_now = what.c_str();
}

DriverWatch::~DriverWatch() { watched_now = outer_; }

}  // namespace ubs::opencl
