// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/driver_watch.hpp"

#include <fcntl.h>
#include <pthread.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"

namespace ubs::opencl {
namespace {

std::atomic<bool> watches{true};
std::atomic<const char*> watched_now{nullptr};
// A copy of the text at watched_now. A thread of the driver reads the copy, because the string itself may be
// destroyed meanwhile, if the caller leaves its DriverWatch.
constexpr std::size_t kLongest = 255;
using Text = char[kLongest + 1];
std::array<std::atomic<char>, kLongest> watched_text{};
std::atomic<pthread_t> caller{};  // the thread that calls drivers
struct sigaction before = {};

void show(const char* what) noexcept {
  for (std::size_t i = 0; what != nullptr && i < kLongest; ++i) {
    watched_text[i].store(what[i], std::memory_order_relaxed);
    if (what[i] == 0) break;
  }
  watched_now = what;
}

// Returns the errno with which writing to PoCL's cache fails, or 0 if it succeeds or there is no cache. This
// and the following functions use neither locks nor the heap, because the driver may have left both in an
// inconsistent state.
int cache_defect(const char* folder) {
  char name[4096] = {};
  if (folder == nullptr ||
      std::snprintf(name, sizeof name, "%s/.probe-%d-end", folder, ::getpid()) >= int{sizeof name})
    return 0;
  const int file = ::open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  const bool written = file >= 0 && ::write(file, name, sizeof name) == ssize_t{sizeof name};
  const int reason = written ? 0 : errno;
  if (file >= 0) ::close(file), ::unlink(name);
  return reason;
}

// Prints an error message and ends the process with the exit code of `kind`.
[[noreturn]] void end(const char* text, ErrorKind kind) {
  char line[1024];
  const auto size = static_cast<std::size_t>(std::snprintf(line, sizeof line, "ubs: error: %s\n", text));
  [[maybe_unused]] const auto written =
      ::write(STDERR_FILENO, line, size < sizeof line ? size : sizeof line - 1);
  ::_exit(exit_code(kind));
}

// Reports that the driver has ended the process while it processed `what`. `deed` says how, such as "has
// aborted".
[[noreturn]] void report(const char* what, const char* deed) {
  char text[1000];
  if (const MemoryRoom room = process_memory(); room.scarce()) {
    std::snprintf(
        text, sizeof text,
        "out of memory in the OpenCL driver (%s): %llu of %llu MiB are left (%s); raise the limit, or "
        "use fewer splats or smaller images",
        what, static_cast<unsigned long long>(room.left >> 20),
        static_cast<unsigned long long>(room.limit >> 20), room.name);
    end(text, ErrorKind::memory);
  }
  const char* folder = std::getenv("POCL_CACHE_DIR");
  if (const int defect = cache_defect(folder); defect != 0) {
    std::snprintf(text, sizeof text,
                  "the OpenCL driver cannot keep compiled kernels in %s (%s); free disk space, or select "
                  "another folder with UBS_KERNEL_CACHE",
                  folder, std::strerror(defect));
    end(text, ErrorKind::data);
  }
  std::snprintf(text, sizeof text, "the OpenCL driver %s (%s); it may have printed the reason above", deed,
                what);
  end(text, ErrorKind::device);
}

// Returns what the driver is processing (in `text`), or null if the driver has not caused the end of the
// process. A thread other than `caller` that ends the process belongs to the driver, because threads of ubs
// never do so.
const char* driver_at_work(Text& text) {
  if (watched_now.load() == nullptr)
    return ::pthread_equal(caller, ::pthread_self()) ? nullptr : "in a thread of its own";
  for (std::size_t i = 0; i < kLongest; ++i) text[i] = watched_text[i].load(std::memory_order_relaxed);
  text[kLongest] = 0;
  return text;
}

void aborted(int signal) {
  Text text;
  if (const char* what = driver_at_work(text)) report(what, "has aborted");
  ::sigaction(signal, &before, nullptr);
  std::raise(signal);
}

// This function is registered with atexit(). During a call of the driver, it only runs if the driver has
// called exit().
void left() {
  Text text;
  if (const char* what = driver_at_work(text)) report(what, "has ended the program");
}

}  // namespace

void leave_drivers_alone() noexcept { watches = false; }

// Installs the signal handler every time, because LLVM replaces it with its own handler at its first use.
DriverWatch::DriverWatch(const std::string& what) noexcept : outer_(watched_now.load()) {
  if (!watches) return;
  struct sigaction ours = {}, found = {};
  ours.sa_handler = aborted;
  ::sigaction(SIGABRT, &ours, &found);
  static std::once_flag once;
  std::call_once(once, [&] {
    before = found;
    std::atexit(left);
  });
  caller = ::pthread_self();
  show(what.c_str());
}

DriverWatch::~DriverWatch() {
  if (watches) show(outer_);
}

}  // namespace ubs::opencl
