// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/estimate.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/stopwatch.hpp"
#include "host/experiment/child_process.hpp"
#include "host/train/plan.hpp"

namespace ubs::experiment {
namespace {

namespace fs = std::filesystem;

constexpr int kSampleIterations = 2;  // between rows of log.csv: each row waits for the device
constexpr std::size_t kWarmUpRows = 2, kMinSamples = 3;
constexpr double kGrowth = 10;    // largest that the settings allow
constexpr int kGrowthSteps = 12;  // 10^12: enough to come from one splat to any cap
constexpr int kRowsAtCap = kGrowthSteps / kSampleIterations + 2;

struct Row {
  double iteration = 0, seconds = 0, splats = 0;
};

std::optional<double> number(const std::string& text) {
  double value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size()) return std::nullopt;
  return value;
}

// Rows of losses; the last line may be incomplete while the run writes it.
std::vector<Row> rows_of(const std::string& csv) {
  std::vector<Row> rows;
  std::istringstream stream(csv);
  for (std::string line; std::getline(stream, line) && !stream.eof();) {
    std::vector<std::string> cells;
    std::istringstream parts(line);
    for (std::string cell; std::getline(parts, cell, ',');) cells.push_back(cell);
    if (cells.size() < 4 || cells[2].empty()) continue;
    const auto iteration = number(cells[0]), seconds = number(cells[1]), splats = number(cells[3]);
    if (iteration && seconds && splats) rows.push_back({*iteration, *seconds, *splats});
  }
  return rows;
}

// Evaluations and renders would only delay the end of a measurement.
TrainSettings short_run(const Job& job, bool at_cap) {
  TrainSettings s = job.settings;
  s.log_every = kSampleIterations;
  s.eval_every = "0";
  s.save_renders = 0;
  s.pyramid.clear();               // whole images are timed; what coarse ones take follows from them
  s.iterations = kScheduleLength;  // so that those of refine are plain iteration numbers
  if (!at_cap) {
    s.refine.end = s.refine.first;
    return s;
  }
  s.refine = {0, kGrowthSteps, 1};
  s.growth = kGrowth;
  s.noise_lr = 0;
  return s;
}

StepTime measure(const Job& job, bool at_cap, const EstimateOptions& options) {
  const fs::path folder = options.work / "step";
  remove_tree(folder);
  make_folders(folder);
  TrainSettings settings = short_run(job, at_cap);
  write_file_atomically(folder / kJobSettings, to_yaml(bind_fields(settings, train_fields())));
  const std::size_t warm_up = at_cap ? kRowsAtCap : kWarmUpRows;
  const auto read = [&] {
    return path_exists(folder / "log.csv") ? read_text_file(folder / "log.csv") : std::string();
  };
  const auto start = Clock::now();
  bool late = false, enough = false;
  const auto poll = [&] {
    const std::vector<Row> rows = rows_of(read());
    enough =
        rows.size() > warm_up + kMinSamples && rows.back().seconds - rows[warm_up].seconds >= options.seconds;
    late = seconds_since(start) > options.patience;
    return enough || late || options.interrupted() ? Request::kill : Request::none;
  };
  const ChildResult end =
      run_child(train_command(job, folder, options.executable, options.device, options.train_arguments),
                folder / "train.log", poll);
  StepTime time = step_time(read(), warm_up);
  if (time.samples < kMinSamples)
    time.problem = late ? fmt::format("no {} samples within {:.0f} s", kMinSamples, options.patience)
                   : end.code != 0 ? reason_of(end.code, end.signal, folder / "train.log")
                                   : "the run ended before it could be timed";
  remove_tree(folder);
  return time;
}

bool same_measurement(const Job& a, const Job& b) {
  return a.set == b.set && a.width == b.width && changed_settings(a.settings, b.settings).empty();
}

std::string text_of(const StepTime& time) {
  if (!time.problem.empty()) return time.problem;
  return fmt::format("{:.2f} ms at {} splats ({} samples)", 1e3 * time.seconds, time.splats, time.samples);
}

}  // namespace

// The mean, not the median: log.csv has milliseconds, too coarse for single samples, and training meets the
// slow iterations, too.
StepTime step_time(const std::string& log_csv, std::size_t warm_up) {
  const std::vector<Row> rows = rows_of(log_csv);
  StepTime time;
  if (!rows.empty()) time.splats = static_cast<std::uint64_t>(rows.back().splats);
  if (rows.size() <= warm_up + 1 || rows.back().iteration <= rows[warm_up].iteration) return time;
  time.samples = rows.size() - warm_up - 1;
  time.seconds =
      (rows.back().seconds - rows[warm_up].seconds) / (rows.back().iteration - rows[warm_up].iteration);
  return time;
}

double training_seconds(const TrainSettings& settings, const StepTime& start, const StepTime& cap) {
  const auto point = [](const StepTime& time) {
    return PlanPoint{.splats = static_cast<std::uint32_t>(time.splats), .step_ms = 1e3 * time.seconds};
  };
  return ubs::training_seconds(settings, point(start), point(cap.samples > 0 ? cap : start));
}

std::vector<Estimate> estimate_hours(const std::vector<Job>& jobs, const EstimateOptions& options) {
  std::vector<Estimate> estimates(jobs.size());
  for (std::size_t i = 0; i < jobs.size() && !options.interrupted(); ++i) {
    const Job& job = jobs[i];
    Estimate& estimate = estimates[i];
    if (!job.runnable()) continue;
    const auto earlier =
        std::find_if(jobs.begin(), jobs.begin() + static_cast<std::ptrdiff_t>(i),
                     [&](const Job& other) { return other.runnable() && same_measurement(other, job); });
    if (earlier != jobs.begin() + static_cast<std::ptrdiff_t>(i)) {
      estimate = estimates[static_cast<std::size_t>(earlier - jobs.begin())];
      estimate.measured = false;
      continue;
    }
    estimate.measured = true;
    estimate.start = measure(job, false, options);
    const bool grows = static_cast<std::uint64_t>(job.settings.cap_max) > estimate.start.splats;
    if (estimate.start.problem.empty() && grows && !options.interrupted())
      estimate.cap = measure(job, true, options);
    if (options.say)
      options.say(fmt::format("{}: {}{}", job.id, text_of(estimate.start),
                              grows && estimate.start.problem.empty() ? ", " + text_of(estimate.cap) : ""));
    if (estimate.start.problem.empty() && estimate.cap.problem.empty() &&
        (!grows || estimate.cap.samples > 0))
      estimate.hours = training_seconds(job.settings, estimate.start, estimate.cap) / 3600;
  }
  return estimates;
}

}  // namespace ubs::experiment
