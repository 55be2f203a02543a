// SPDX-License-Identifier: Apache-2.0
// Tests that the tracer records what a command does to files, and that it introduces the requested faults.
#include "tests/fault/traced_run.hpp"

#include <cerrno>
#include <csignal>

namespace ubs::test {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> names_and_paths(const TracedRun& run, unsigned kinds) {
  std::vector<std::string> lines;
  for (const Call& call : run.calls)
    if ((call.kind & kinds) != 0)
      lines.push_back(fmt::format("{} {}{}", call.name, call.path, call.to.empty() ? "" : " > " + call.to));
  return lines;
}

TEST_CASE("traced run: calls of the command, its children and the C library are recorded in order") {
  REQUIRE(can_trace());
  const TempFolder folder;
  fs::create_directories(folder / "out/inner");
  put(folder / "out/old", "old");
  fs::create_directory_symlink(folder / "out/inner", folder / "alias");
  const char* script =
      "echo one >elsewhere; (echo two >out/two); dd if=/dev/zero of=out/three bs=10 count=2 conv=fsync; "
      "mv out/two out/four; truncate -s 3 out/three; rm out/old; tr a b <out/four >alias/five; "
      "rmdir out/none; exit 4";
  const TracedRun run = trace_command(folder, fmt::format("sh -c '{}'", script), folder / "out");
  INFO(to_text(run.calls));
  CHECK(run.code == 4);
  CHECK(run.signal == 0);
  CHECK_FALSE(run.hung);
  CHECK(names_and_paths(run, open_calls) ==
        std::vector<std::string>{"openat two", "openat three", "openat three", "openat inner/five"});
  CHECK(names_and_paths(run, write_calls) ==
        std::vector<std::string>{"write two", "write three", "write three", "write inner/five"});
  CHECK(names_and_paths(run, sync_calls) == std::vector<std::string>{"fsync three"});
  CHECK(run.count(rename_calls) == 1);
  CHECK(run.count(resize_calls) >= 1);
  CHECK(names_and_paths(run, remove_calls) == std::vector<std::string>{"unlinkat old", "rmdir none"});
  CHECK(run.calls.back().result == -ENOENT);
  CHECK(names_and_paths(run, look_calls) == std::vector<std::string>{"openat four"});
  CHECK(run.count(read_calls) >= 2);
  CHECK(get(folder / "out/inner/five") == "two\n");
}

TEST_CASE("traced run: the n-th call can fail, be shortened or end the process, and a time limit works") {
  REQUIRE(can_trace());
  const TempFolder folder;
  fs::create_directory(folder / "out");
  const std::string command = "sh -c 'echo one >out/1; echo two >out/2; echo three >out/3; mv out/3 out/4'";
  const auto with = [&](const Fault& fault) {
    fs::remove_all(folder / "out");
    fs::create_directory(folder / "out");
    TracedRun run = trace_command(folder, command, folder / "out", fault);
    CHECK(run.struck);
    return run;
  };
  TracedRun run = with({.kinds = write_calls, .nth = 2, .action = Fault::fail, .number = ENOSPC});
  CHECK(to_text(run.calls).find(fmt::format("write 2 = {}", -ENOSPC)) != std::string::npos);
  CHECK(run.err.find("echo: I/O error") != std::string::npos);
  CHECK(get(folder / "out/1") == "one\n");
  CHECK(get(folder / "out/2").empty());
  CHECK(get(folder / "out/4") == "three\n");
  with({.kinds = write_calls, .nth = 2, .action = Fault::fail, .number = ENOSPC, .lasting = true});
  CHECK(get(folder / "out/4").empty());
  with({.kinds = write_calls, .nth = 3, .action = Fault::shorten});
  CHECK(get(folder / "out/4").starts_with("thr"));
  with({.kinds = open_calls, .nth = 3, .action = Fault::fail, .number = EACCES});
  CHECK_FALSE(fs::exists(folder / "out/4"));

  run = with({.kinds = rename_calls, .nth = 1, .action = Fault::kill_before});
  CHECK(get(folder / "out/3") == "three\n");
  run = with({.kinds = rename_calls, .nth = 1, .action = Fault::kill_after});
  CHECK(get(folder / "out/4") == "three\n");
  run = with({.kinds = write_calls, .nth = 1, .action = Fault::kill_after});
  CHECK(run.signal == SIGKILL);
  CHECK(run.code == -1);
  CHECK(get(folder / "out/1") == "one\n");
  CHECK_FALSE(fs::exists(folder / "out/2"));
  run = with({.kinds = write_calls, .nth = 2, .action = Fault::signal, .number = SIGTERM});
  CHECK(run.signal == SIGTERM);
  CHECK_FALSE(fs::exists(folder / "out/3"));
  CHECK(trace_command(folder, "sleep 60", folder / "out", {}, 1).hung);
}

}  // namespace
}  // namespace ubs::test
