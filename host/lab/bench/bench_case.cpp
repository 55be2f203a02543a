// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/bench_case.hpp"

#include <charconv>
#include <regex>

#include "host/base/error.hpp"

namespace ubs::bench {
namespace {

// Reads a number, optionally followed by K or M, and advances `at`. Returns 0 if there is no number, or if
// the number before K or M exceeds 100 million.
std::size_t read_count(const char*& at, const char* end) {
  std::size_t value = 0;
  const auto result = std::from_chars(at, end, value);
  if (result.ec != std::errc() || value > 100'000'000) return 0;
  at = result.ptr;
  if (at != end && (*at == 'K' || *at == 'k'))
    value *= 1000, ++at;
  else if (at != end && (*at == 'M' || *at == 'm'))
    value *= 1'000'000, ++at;
  return value;
}

void add_scene(std::vector<BenchCase>& cases, const std::string& scene, const std::vector<SceneSize>& sizes) {
  for (const SceneSize& size : sizes) {
    const auto add = [&](const std::string& stage) {
      cases.push_back({stage, scene, size.splats, size.width, size.height});
    };
    for (const std::string& stage : step_stages()) add(stage);
    add("forward_backward");
    add("iteration");
    if (scene == "synthetic")
      for (const char* stage : {"iteration_unguarded", "iteration_wait", "iteration_bound"}) add(stage);
    add("render");
  }
}

}  // namespace

std::string count_text(std::size_t count) {
  if (count >= 1'000'000 && count % 1'000'000 == 0) return fmt::format("{}M", count / 1'000'000);
  if (count >= 1000 && count % 1000 == 0) return fmt::format("{}K", count / 1000);
  return std::to_string(count);
}

std::string BenchCase::name() const {
  return fmt::format("{}.{}.{}.{}x{}", stage, scene, count_text(splats), width, height);
}

SceneSize parse_scene_size(const std::string& text) {
  const char *at = text.data(), *end = at + text.size();
  const std::size_t width = read_count(at, end);
  bool good = width > 0 && at != end && *at++ == 'x';
  const std::size_t height = good ? read_count(at, end) : 0;
  good = height > 0 && at != end && *at++ == '/';
  const std::size_t splats = good ? read_count(at, end) : 0;
  if (splats == 0 || at != end || width > 16384 || height > 16384)
    fail(ErrorKind::usage, "'{}' is not an image size and a number of splats, such as 400x400/100K", text);
  return {splats, static_cast<int>(width), static_cast<int>(height)};
}

const std::vector<std::string>& step_stages() {
  static const std::vector<std::string> stages{"project_forward",
                                               "lists",
                                               "raster_forward",
                                               "image_loss",
                                               "raster_backward",
                                               "sum_slots",
                                               "project_backward",
                                               "regularise",
                                               "adam",
                                               "learn",
                                               "relocate",
                                               "grow",
                                               "noise"};
  return stages;
}

std::vector<BenchCase> all_cases(const CaseOptions& options) {
  const auto sizes = [&](std::vector<SceneSize> usual) {
    if (!options.sizes.empty()) return options.sizes;
    return options.quick ? std::vector<SceneSize>{{1000, 48, 32}} : usual;
  };
  const SceneSize small{30'000, 200, 200}, middle{100'000, 400, 400}, large{300'000, 800, 800};
  std::vector<BenchCase> cases;
  add_scene(cases, "synthetic", sizes({small, middle, large}));
  add_scene(cases, "random", sizes({small, middle}));
  for (const char* scene : {"glossy", "orbit", "cloud"}) add_scene(cases, scene, sizes({small}));
  if (options.garden.splats > 0) add_scene(cases, "garden", {options.garden});
  if (options.model.splats > 0 && options.mixed_model)
    cases.push_back({"render", "model", options.model.splats, options.model.width, options.model.height});
  else if (options.model.splats > 0)
    add_scene(cases, "model", {options.model});
  return cases;
}

std::vector<BenchCase> select_cases(const std::vector<BenchCase>& cases, const std::string& regex) {
  std::regex pattern;
  try {
    pattern = std::regex(regex, std::regex::ECMAScript);
  } catch (const std::regex_error& error) {
    fail(ErrorKind::usage, "--run '{}' is not a valid regular expression: {}", regex, error.what());
  }
  std::vector<BenchCase> selected;
  for (const BenchCase& c : cases)
    if (std::regex_search(c.name(), pattern)) selected.push_back(c);
  return selected;
}

}  // namespace ubs::bench
