// SPDX-License-Identifier: Apache-2.0
// Tests run_child() in processes that ignore signals.
#include "host/base/child_process.hpp"

#include <catch2/catch.hpp>
#include <csignal>
#include <cstdlib>

#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

// Ignores a signal during its lifetime.
class IgnoredSignal {
 public:
  explicit IgnoredSignal(int number) : number_(number), before_(std::signal(number, SIG_IGN)) {}
  ~IgnoredSignal() { std::signal(number_, before_); }
  IgnoredSignal(const IgnoredSignal&) = delete;
  IgnoredSignal& operator=(const IgnoredSignal&) = delete;

 private:
  int number_;
  void (*before_)(int);
};

}  // namespace

TEST_CASE("a child process does not ignore the signals that ubs or its parent ignores") {
  const test::TempFolder folder;
  const IgnoredSignal pipe(SIGPIPE), size(SIGXFSZ), child(SIGCHLD);
  run_child({"/bin/cat", "/proc/self/status"}, folder / "log", [] { return false; });
  const std::string log = test::get(folder / "log"), name = "SigIgn:";
  REQUIRE(test::contains(log, name));
  const std::uint64_t ignored = std::strtoull(log.c_str() + log.find(name) + name.size(), nullptr, 16);
  for (const int number : kSignalsOfChildren) CHECK((ignored >> (number - 1) & 1) == 0);
}

TEST_CASE("the end of a child process is noticed if its status is not available") {
  const test::TempFolder folder;
  const IgnoredSignal child(SIGCHLD);
  int calls = 0;
  const auto stop = [&] {
    if (++calls == 10000) throw std::runtime_error("the end of the child process was not noticed");
    return false;
  };
  const ChildResult result = run_child({"/bin/sh", "-c", "echo done"}, folder / "log", stop);
  CHECK(test::contains(test::get(folder / "log"), "done"));
  CHECK(result.code == 0);
  CHECK(result.signal == 0);
}

}  // namespace ubs
