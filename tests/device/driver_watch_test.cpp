// SPDX-License-Identifier: Apache-2.0
// Tests what happens if a driver terminates the process. ubs must print one line, and exit with a code that
// depends on the cause.
#include "host/opencl/driver_watch.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <functional>
#include <new>

#include "host/base/memory_limit.hpp"
#include "tests/support/set_variable.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

struct End {
  int code;  // exit code, or -1 if a signal has ended the process
  std::string err;
};

// Runs the action in a child process and returns how this process ends.
End end_of(const std::function<void()>& action) {
  const test::TempFolder folder;
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    const int file = ::open((folder / "err").c_str(), O_WRONLY | O_CREAT, 0600);
    ::dup2(file, STDERR_FILENO);
    std::signal(SIGABRT, SIG_DFL);  // removes the handler of Catch2
    action();
    ::_exit(99);
  }
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, test::get(folder / "err")};
}

int driver(const std::function<void()>& call) {
  const std::string what = "kernel 'adam_step'";
  return opencl::watched(what, [&] {
    call();
    return 0;
  });
}

bool says(const End& end, const std::string& part) {
  return end.err.find("ubs: error: ") != std::string::npos && end.err.find(part) != std::string::npos;
}

TEST_CASE("if a driver aborts, exits or throws, the message contains the operation, and the exit code is 4") {
  const test::Variable cache("POCL_CACHE_DIR", nullptr);
  for (const auto& call : {+[] { std::abort(); }, +[] { std::exit(1); }, +[] { throw std::bad_alloc(); }}) {
    const End end = end_of([&] { driver(call); });
    INFO(end.err);
    CHECK(end.code == 4);
    CHECK(says(end, "kernel 'adam_step'"));
  }
  CHECK(end_of([] { ::_exit(driver([] {}) == 0 ? 5 : 6); }).code == 5);
  // Outside of a call of the driver, exit() and abort() have their usual effect.
  CHECK(end_of([] {
          driver([] {});
          std::exit(7);
        }).code == 7);
  CHECK(end_of([] {
          driver([] {});
          std::abort();
        }).code == -1);
}

TEST_CASE("the exit code is 6 if a driver runs out of memory, and 3 if it cannot write its cache") {
  const End memory = end_of([] {
    const rlimit limit{std::uint64_t{1} << 20, std::uint64_t{1} << 20};
    setrlimit(RLIMIT_AS, &limit);
    driver([] { std::abort(); });
  });
  INFO(memory.err);
  CHECK(memory.code == 6);
  CHECK(says(memory, "0 of 1 MiB are left (address space, ulimit -v)"));

  const test::TempFolder folder;
  test::put(folder / "file", "");
  const test::Variable cache("POCL_CACHE_DIR", (folder / "file").c_str());
  const End disk = end_of([] { driver([] { std::exit(1); }); });
  INFO(disk.err);
  CHECK(disk.code == 3);
  CHECK(says(disk, (folder / "file").string()));
}

TEST_CASE("the available memory takes the memory limits of the process into account") {
  CHECK(end_of([] {
          const bool before = process_memory().left == kNoMemoryLimit || memory_limits_text() != "";
          const rlimit limit{std::uint64_t{64} << 30, RLIM_INFINITY};
          setrlimit(RLIMIT_AS, &limit);
          const MemoryRoom room = process_memory();
          const bool after =
              room.limit == limit.rlim_cur && room.left < room.limit && !room.scarce() &&
              memory_left() < room.left &&
              memory_limits_text().find("65536 MiB (address space, ulimit -v)") != std::string::npos;
          ::_exit(before && after ? 0 : 1);
        }).code == 0);
}

}  // namespace
}  // namespace ubs
