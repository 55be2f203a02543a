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

}  // namespace
}  // namespace ubs
