// SPDX-License-Identifier: Apache-2.0
#include "host/bench/tuner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "host/base/error.hpp"
#include "host/bench/step_bench.hpp"
#include "host/opencl/opencl_device.hpp"

namespace ubs::bench {
namespace {

constexpr double kLeastGain = 0.02, kErrors = 3;
// Other batches, groups and tiles only change the order and shifts of sums; observed: 9e-6 of the gradient
// row with the most cancellation.
constexpr double kMostDifference = 1e-4;
constexpr int kRounds = 15, kQuickRounds = 3;
constexpr double kRoundMs = 20, kQuickRoundMs = 1;

class Tuner {
 public:
  Tuner(opencl::OpenclDevice& device, const TuneOptions& options)
      : device_(device),
        options_(options),
        scene_(options.quick ? synthetic_object(6, 3'000, 64, 64, 1)
                             : synthetic_object(6, 100'000, 400, 400, 1)) {}

  TuningValues run() {
    current_ = make({});
    reference_ = current_->outputs();
    for (const TunedConstant& constant : opencl::tuned_constants())
      if (constant.raster == options_.raster) sweep(constant);
    current_.reset();
    device_.set_tuning(values_);
    return values_;
  }

 private:
  std::unique_ptr<StepBench> make(const TuningValues& values) {
    device_.set_tuning(values);
    return std::make_unique<StepBench>(device_, scene_, options_.raster);
  }

  void sweep(const TunedConstant& constant) {
    std::vector<Trial> trials;
    for (const unsigned value : constant.candidates) {
      const Trial trial = try_value(constant, value, options_.quick ? kQuickRounds : kRounds);
      if (clearly_faster(trial))
        trials.push_back(trial);
      else
        report(trial);
    }
    // The best of several noisy values looks better than it is: it has to win once more.
    std::ranges::sort(trials, {}, &Trial::ratio);
    bool found = false;
    for (Trial& trial : trials) {
      if (!found) {
        const int rounds = 2 * (options_.quick ? kQuickRounds : kRounds);
        trial = try_value(constant, trial.value, rounds);
        found = trial.kept = clearly_faster(trial);
        if (found) best_ = std::move(candidate_);
      }
      report(trial);
      if (trial.kept) values_[trial.macro] = trial.value;
    }
    if (found) current_ = std::move(best_);
    candidate_.reset();
  }

  Trial try_value(const TunedConstant& constant, unsigned value, int rounds) {
    Trial trial{.macro = std::string(constant.macro), .value = value, .note = {}};
    TuningValues values = values_;
    values[trial.macro] = value;
    candidate_.reset();
    try {
      candidate_ = make(values);
    } catch (const Error& error) {
      // More local memory or work-items than the device has.
      if (error.kind() != ErrorKind::build && error.kind() != ErrorKind::device &&
          error.kind() != ErrorKind::memory)
        throw;
      trial.note = "does not run on this device";
      return trial;
    }
    trial.difference = relative_difference(candidate_->outputs(), reference_);
    if (!(trial.difference <= kMostDifference)) {
      trial.note = fmt::format("results differ by {:.1e}", trial.difference);
      return trial;
    }
    const Summary ratios = compare(constant.stages, rounds);
    trial.ratio = ratios.median;
    trial.uncertainty = ratios.uncertainty() * ratios.median;
    return trial;
  }

  // Time of the candidate over that of the current values, taken in turn: what slows the machine down for
  // longer than a round cancels.
  Summary compare(const std::vector<std::string>& stages, int rounds) {
    std::vector<int> calls;
    for (const std::string& stage : stages) {
      candidate_->time_ms(stage, 1);
      const double once =
          std::max(1e-3, std::min(current_->time_ms(stage, 1), candidate_->time_ms(stage, 1)));
      const double wanted = options_.quick ? kQuickRoundMs : kRoundMs;
      calls.push_back(std::clamp(static_cast<int>(std::ceil(wanted / once)), 1, 64));
    }
    const auto total = [&](StepBench& bench) {
      double sum = 0;
      for (std::size_t i = 0; i < stages.size(); ++i) sum += bench.time_ms(stages[i], calls[i]);
      return sum;
    };
    std::vector<double> ratios;
    for (int round = 0; round < rounds; ++round) {
      const bool candidate_first = round % 2 == 1;
      const double first = total(candidate_first ? *candidate_ : *current_);
      const double second = total(candidate_first ? *current_ : *candidate_);
      ratios.push_back(candidate_first ? first / second : second / first);
    }
    return summarise(ratios);
  }

  void report(const Trial& trial) const {
    if (options_.on_trial) options_.on_trial(trial);
  }

  opencl::OpenclDevice& device_;
  const TuneOptions& options_;
  BenchScene scene_;
  TuningValues values_;
  Parts reference_;  // of the defaults
  std::unique_ptr<StepBench> current_, candidate_, best_;
};

double part_difference(const std::vector<float>& a, const std::vector<float>& b) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  if (a.size() != b.size()) return kInfinite;
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double x = a[i], y = b[i];
    difference += (x - y) * (x - y);
    size += y * y;
  }
  if (difference == 0) return 0;
  const double relative = std::sqrt(difference / size);
  return std::isfinite(relative) ? relative : kInfinite;
}

}  // namespace

bool clearly_faster(const Trial& trial) {
  return trial.note.empty() && trial.ratio < 1 - std::max(kLeastGain, kErrors * trial.uncertainty);
}

double relative_difference(const Parts& a, const Parts& b) {
  double largest = a.size() == b.size() ? 0 : std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    largest = std::max(largest, part_difference(a[i], b[i]));
  return largest;
}

TuningValues tune(Device& device, const TuneOptions& options) {
  auto* opencl_device = dynamic_cast<opencl::OpenclDevice*>(&device);
  if (!opencl_device)
    fail(ErrorKind::usage, "{} is no OpenCL device: there is nothing to tune", device.info().name);
  return Tuner(*opencl_device, options).run();
}

}  // namespace ubs::bench
