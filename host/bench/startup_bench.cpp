// SPDX-License-Identifier: Apache-2.0
#include "host/bench/startup_bench.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <string_view>
#include <utility>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/stopwatch.hpp"
#include "host/data/synthetic.hpp"

namespace ubs::bench {
namespace {

namespace fs = std::filesystem;

std::vector<char*> pointers(std::vector<std::string>& texts) {
  std::vector<char*> result;
  for (std::string& text : texts) result.push_back(text.data());
  result.push_back(nullptr);
  return result;
}

// This process's environment with all caches of compiled kernels in `cache`.
std::vector<std::string> environment_with(const fs::path& cache) {
  constexpr std::string_view kCaches[] = {"POCL_CACHE_DIR=", "CUDA_CACHE_PATH=", "UBS_KERNEL_CACHE="};
  std::vector<std::string> variables;
  for (char** at = environ; *at; ++at)
    if (std::ranges::none_of(kCaches, [&](auto name) { return std::string_view(*at).starts_with(name); }))
      variables.emplace_back(*at);
  for (const std::string_view name : kCaches) variables.push_back(std::string(name) + cache.string());
  return variables;
}

int run_process(const fs::path& executable, std::vector<std::string> arguments, const fs::path& cache,
                const fs::path& output) {
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_adddup2(&files, STDOUT_FILENO, STDERR_FILENO);
  std::vector<std::string> variables = environment_with(cache);
  pid_t child = 0;
  const int code = posix_spawn(&child, executable.c_str(), &files, nullptr, pointers(arguments).data(),
                               pointers(variables).data());
  posix_spawn_file_actions_destroy(&files);
  if (code != 0) fail(ErrorKind::internal, "{}: cannot be started", executable.string());
  int status = 0;
  if (waitpid(child, &status, 0) != child) fail(ErrorKind::internal, "{}: lost", executable.string());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace

StartupBench::StartupBench(StartupOptions options) : options_(std::move(options)) {
  export_synthetic({.scene = "glossy",
                    .width = options_.width,
                    .height = options_.height,
                    .train_views = 2,
                    .test_views = 0,
                    .supersampling = 1},
                   folder_.path() / "data");
}

double StartupBench::milliseconds(const std::string& cache) const {
  const fs::path root = folder_.path(), output = root / "output.txt";
  make_folders(root / cache);
  const std::string count = std::to_string(options_.splats);
  std::vector<std::string> arguments{options_.executable.string(),
                                     "train",
                                     "--data",
                                     (root / "data").string(),
                                     "--out",
                                     (root / "run").string(),
                                     "--overwrite",
                                     "--quiet",
                                     "--iterations",
                                     "1",
                                     "--init-points",
                                     count,
                                     "--cap-max",
                                     count,
                                     "--dim",
                                     std::to_string(options_.dim),
                                     "--raster",
                                     options_.raster};
  if (!options_.device.empty()) arguments.insert(arguments.end(), {"--device", options_.device});
  for (const std::string& setting : options_.settings) arguments.insert(arguments.end(), {"--set", setting});
  const Stopwatch watch;
  const int code = run_process(options_.executable, arguments, root / cache, output);
  const double time = watch.milliseconds();
  if (code != 0) {
    std::string text = read_text_file(output);
    std::replace(text.begin(), text.end(), '\n', ' ');
    fail(ErrorKind::device, "start-up run ended with code {}: {}", code, text);
  }
  return time;
}

Summary StartupBench::measure(bool cold) {
  const auto fresh = [&] { return fmt::format("cache{}", caches_++); };
  std::vector<double> times;
  if (cold) {
    for (int i = 0; i < std::min(2, options_.repetitions); ++i) times.push_back(milliseconds(fresh()));
    return summarise(times);
  }
  if (caches_ == 0) milliseconds(fresh());
  for (int i = 0; i < options_.repetitions; ++i) times.push_back(milliseconds("cache0"));
  return summarise(times);
}

}  // namespace ubs::bench
