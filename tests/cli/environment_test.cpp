// SPDX-License-Identifier: Apache-2.0
// The executable in a hostile environment: caches that cannot be written, closed or full standard streams,
// little memory, signals.
#include <catch2/catch.hpp>

#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

using test::check_error;
using test::get;
using test::put;
using test::Result;
using test::run_command;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

// `variables` in the place of what the test was started with.
std::string with_cache(const std::string& variables, const std::string& arguments) {
  return fmt::format("env -u POCL_CACHE_DIR -u UBS_KERNEL_CACHE -u XDG_CACHE_HOME TMPDIR=$PWD {} '{}' {}",
                     variables, UBS_EXECUTABLE, arguments);
}

std::size_t lines(const std::string& text) {
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

bool works(const std::string& command) { return std::system((command + " >/dev/null 2>&1").c_str()) == 0; }

TEST_CASE("a kernel cache that cannot be written is replaced, in one line") {
  for (const std::string variable : {"UBS_KERNEL_CACHE", "XDG_CACHE_HOME", "HOME", "POCL_CACHE_DIR"}) {
    const TempFolder folder;
    put(folder / "file", "");
    const Result result = run_command(folder, with_cache(variable + "=file", "devices"));
    INFO(variable << "\n" << result.err);
    CHECK(result.code == 0);
    CHECK(result.out.find("Portable Computing Language") != std::string::npos);
    CHECK(lines(result.err) == 1);
    CHECK(result.err.find((folder / "file").string()) != std::string::npos);
    const std::string own = fmt::format("ubs-{}", ::geteuid());
    CHECK(result.err.find(own) != std::string::npos);
    CHECK(std::filesystem::is_directory(folder / own / "pocl"));
  }
}

TEST_CASE("PoCL keeps its kernels in our folder, and nothing with off") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --width 16 --height 16 --views 2 --test-views 1");
  const auto train = [&](const std::string& variable) {
    return run_command(folder, with_cache(variable,
                                          "train --data data --out run --overwrite --quiet "
                                          "--dim 3 --iterations 1 --init-points 10 --cap-max 10"));
  };
  const auto kept = [&](const std::string& where) {
    std::size_t libraries = 0;
    for (const auto& file : std::filesystem::recursive_directory_iterator(folder / where))
      libraries += file.path().extension() == ".so" ? 1 : 0;
    return libraries;
  };
  const Result result = train("UBS_KERNEL_CACHE=kernels");
  INFO(result.err);
  CHECK(result.code == 0);
  CHECK(result.err.empty());
  CHECK(kept("kernels/pocl") > 5);
  CHECK(train("UBS_KERNEL_CACHE=off").code == 0);
  CHECK(kept(fmt::format("ubs-{}/pocl", ::geteuid())) == 0);
}

TEST_CASE("without any folder for kernels the error says so, not that a driver is missing") {
  const TempFolder folder;
  put(folder / "file", "");
  const Result result = run_command(folder, with_cache("HOME=file TMPDIR=/proc", "devices"));
  INFO(result.err);
  CHECK(result.code == 3);
  CHECK(lines(result.err) == 1);
  CHECK(result.err.find("file/.cache/ubs") != std::string::npos);
  CHECK(result.err.find("/proc/ubs-") != std::string::npos);
}

TEST_CASE("a full disk under the kernel cache is found before the driver is used") {
  if (!works("unshare -rm true")) {
    WARN("no user namespaces here: not tested");
    return;
  }
  const TempFolder folder;
  std::filesystem::create_directories(folder / "full");
  const Result result =
      run_command(folder, fmt::format("unshare -rm sh -c \"mount -t tmpfs -o size=1m none full && {}\"",
                                      with_cache("UBS_KERNEL_CACHE=full/cache TMPDIR=.", "devices")));
  INFO(result.err);
  CHECK(result.code == 0);
  CHECK(result.err.find("No space left on device") != std::string::npos);
}

// A tiny data set and, with `iterations`, how it is trained in a moment.
void make_data(const TempFolder& folder) {
  ubs_ok(folder, "synth glossy --out data --width 16 --height 16 --views 2 --test-views 1");
}

std::string train_command(int iterations, const std::string& more = "") {
  return fmt::format(
      "'{}' train --data data --out run --overwrite --dim 3 --iterations {} --init-points 10 --cap-max 10 {}",
      UBS_EXECUTABLE, iterations, more);
}

TEST_CASE("what cannot be written to stdout is an error of every command") {
  const TempFolder folder;
  make_data(folder);
  REQUIRE(run_command(folder, train_command(1, "--quiet")).code == 0);
  std::filesystem::rename(folder / "run", folder / "before");
  const std::string data = "--data data --dim 3 --iterations 1 --init-points 10 --cap-max 10";
  for (const std::string& arguments :
       {std::string("--help"), std::string("--version"), std::string("train --help"), std::string("devices"),
        std::string("devices --json"), std::string("info before/model.ply"), std::string("info data --json"),
        std::string("stress --list"), std::string("metrics before/renders before/renders"), "plan " + data,
        "plan --json " + data, std::string("eval --model before/model.ply --data data"),
        std::string("convert before/model.ply copy.ply"),
        std::string("pack data --out copy.ubsd"), "train --out run " + data,
        "train --out run2 --json " + data}) {
    const Result result =
        run_command(folder, fmt::format("sh -c \"'{}' {} >/dev/full\"", UBS_EXECUTABLE, arguments));
    INFO(arguments << "\n" << result.err);
    CHECK(result.code == 3);
    CHECK(result.err.find("ubs: error: standard output cannot be written: No space left on device\n") !=
          std::string::npos);
  }
  // Commands that write files have written them all the same.
  for (const char* file : {"copy.ply", "copy.ubsd", "run/model.ply", "run2/metrics.json"})
    CHECK(std::filesystem::exists(folder / file));
  const Result errors =
      run_command(folder, fmt::format("sh -c \"'{}' info missing 2>/dev/full\"", UBS_EXECUTABLE));
  CHECK(errors.code == 3);
}

TEST_CASE("a reader that goes away ends a command that prints, quietly, and no training") {
  const TempFolder folder;
  make_data(folder);
  // The pipe is closed before anything is written to it.
  const auto into_closed_pipe = [&](const std::string& command) {
    const Result result = run_command(
        folder, fmt::format("bash -c \"(sleep 0.2; {} 2>err.txt; echo \\$? >code.txt) | true\"", command));
    CHECK(result.code == 0);
    return std::stoi(get(folder / "code.txt"));
  };
  CHECK(into_closed_pipe(fmt::format("'{}' stress --list", UBS_EXECUTABLE)) == 3);
  CHECK(get(folder / "err.txt").empty());
  CHECK(into_closed_pipe(fmt::format("'{}' --help", UBS_EXECUTABLE)) == 3);
  CHECK(get(folder / "err.txt").empty());
  CHECK(into_closed_pipe(train_command(30)) == 0);
  CHECK(get(folder / "err.txt").find("ubs: ") == std::string::npos);
  CHECK(std::filesystem::exists(folder / "run/model.ply"));
  std::filesystem::remove_all(folder / "run");
  // Progress to a closed pipe: 2>&1.
  CHECK(into_closed_pipe("exec 2>&1; " + train_command(30, "--set eval_every=10")) == 0);
  CHECK(std::filesystem::exists(folder / "run/model.ply"));
}

TEST_CASE("closed standard streams: no file of ours takes their place") {
  const TempFolder folder;
  make_data(folder);
  for (const char* closed : {">&- 2>&-", ">&-", "2>&-", "<&- >&- 2>&-", "<&-"}) {
    const Result result = run_command(
        folder,
        fmt::format("sh -c \"{} {}\"", train_command(30, "--set eval_every=10 --set log_every=1"), closed));
    INFO(closed << "\n" << result.err);
    CHECK(result.code == 0);
    CHECK(std::filesystem::file_size(folder / "run/model.ply") > 500);
    const std::string log = get(folder / "run/log.csv");
    CHECK(lines(log) == 31);
    for (const char* word : {"it/s", "splats in", "device "}) CHECK(log.find(word) == std::string::npos);
  }
}

TEST_CASE("the largest size of a file is an error, not a signal") {
  const TempFolder folder;
  const Result result = run_command(
      folder, fmt::format("bash -c \"ulimit -f 4; exec '{}' synth glossy --out data\"", UBS_EXECUTABLE));
  INFO(result.err);
  CHECK(result.code == 3);
  CHECK(result.err.find("ubs: error: ") != std::string::npos);
}

TEST_CASE("subcommands print through say() and remark() alone") {
  for (const auto& file : std::filesystem::recursive_directory_iterator(UBS_SOURCE_DIR "/tools")) {
    if (file.path().extension() != ".cpp") continue;
    INFO(file.path());
    const std::string text = get(file.path());
    for (const char* other : {"fmt::print(", "std::cout", "std::printf(", "std::puts("})
      CHECK(text.find(other) == std::string::npos);
  }
}

}  // namespace
}  // namespace ubs
