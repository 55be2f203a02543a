// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/tuner.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/statistics.hpp"
#include "host/base/stopwatch.hpp"

namespace ubs::bench {
namespace {

constexpr double kMinGain = 0.02, kErrors = 3;
// Maximum relative difference of the results. Other sizes of batches, groups and tiles change only the order
// of sums, and the values that the image loss subtracts before it sums. The largest difference that was
// observed is 9e-6, in the gradient row with the most cancellation.
constexpr double kMaxDifference = 1e-4;
constexpr int kRounds = 15, kQuickRounds = 3;
constexpr double kRoundMs = 20, kQuickRoundMs = 1;

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

class Tuner {
 public:
  Tuner(TunedTable table, const MakeSubject& make, const TuneOptions& options)
      : table_(table), make_(make), options_(options) {}

  TuningValues run() {
    current_ = make_({});
    reference_ = current_->outputs();
    for (const TunedConstant& constant : table_)
      if (constant.raster == options_.raster) sweep(constant);
    return values_;
  }

 private:
  int rounds() const { return options_.quick ? kQuickRounds : kRounds; }
  bool out_of_time() const { return watch_.seconds() > options_.max_seconds; }

  void sweep(const TunedConstant& constant) {
    std::vector<Trial> trials;
    for (const unsigned value : constant.candidates) {
      const Trial trial = try_value(constant, value, rounds());
      if (clearly_faster(trial))
        trials.push_back(trial);
      else
        report(trial);
    }
    // The best of several noisy measurements appears better than it is. Therefore a value is kept only if it
    // is clearly faster in a second measurement, too.
    std::ranges::sort(trials, {}, &Trial::ratio);
    bool found = false;
    for (Trial& trial : trials) {
      if (!found) {
        trial = try_value(constant, trial.value, 2 * rounds());
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
    if (out_of_time()) {
      trial.note = "not tried: no time left";
      trial.skipped = true;
      return trial;
    }
    TuningValues values = values_;
    values[trial.macro] = value;
    candidate_.reset();
    try {
      candidate_ = make_(values);
      measure(constant, rounds, trial);
    } catch (const Error& error) {
      // The value may need more local memory or work-items than the device has, or a compiler may be missing.
      if (error.kind() != ErrorKind::build && error.kind() != ErrorKind::device &&
          error.kind() != ErrorKind::memory)
        throw;
      trial.note = "does not run on this device: " + first_line(error.what());
    }
    return trial;
  }

  void measure(const TunedConstant& constant, int rounds, Trial& trial) {
    trial.difference = relative_difference(candidate_->outputs(), reference_);
    if (!(trial.difference <= kMaxDifference)) {
      trial.note = fmt::format("results differ by {:.1e}", trial.difference);
      return;
    }
    compare(constant.stages, rounds, trial);
  }

  // Measures the ratio of two times: the time with the candidate, divided by the time with the current
  // values. The two are measured in turn, so that a slowdown of the machine that lasts longer than a round
  // cancels.
  void compare(const std::vector<std::string>& stages, int rounds, Trial& trial) {
    std::vector<int> calls;
    for (const std::string& stage : stages) {
      candidate_->time_ms(stage, 1);
      const double once =
          std::max(1e-3, std::min(current_->time_ms(stage, 1), candidate_->time_ms(stage, 1)));
      const double wanted = options_.quick ? kQuickRoundMs : kRoundMs;
      calls.push_back(std::clamp(static_cast<int>(std::ceil(wanted / once)), 1, 64));
    }
    const auto total = [&](TuneSubject& subject) {
      double sum = 0;
      for (std::size_t i = 0; i < stages.size(); ++i) sum += subject.time_ms(stages[i], calls[i]);
      return sum;
    };
    std::vector<double> ratios, times, before;
    for (int round = 0; round < rounds; ++round) {
      const bool candidate_first = round % 2 == 1;
      const double first = total(candidate_first ? *candidate_ : *current_);
      const double second = total(candidate_first ? *current_ : *candidate_);
      times.push_back(candidate_first ? first : second);
      before.push_back(candidate_first ? second : first);
      ratios.push_back(times.back() / before.back());
    }
    const Summary summary = summarise(ratios);
    trial.ms = summarise(times).median;
    trial.before_ms = summarise(before).median;
    trial.ratio = summary.median;
    trial.uncertainty = summary.uncertainty() * summary.median;
  }

  void report(const Trial& trial) const {
    if (options_.on_trial) options_.on_trial(trial);
  }

  TunedTable table_;
  const MakeSubject& make_;
  const TuneOptions& options_;
  Stopwatch watch_;
  TuningValues values_;
  Parts reference_;  // results with the default values
  std::unique_ptr<TuneSubject> current_, candidate_, best_;
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
  return trial.note.empty() && trial.ratio < 1 - std::max(kMinGain, kErrors * trial.uncertainty);
}

double relative_difference(const Parts& a, const Parts& b) {
  double largest = a.size() == b.size() ? 0 : std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    largest = std::max(largest, part_difference(a[i], b[i]));
  return largest;
}

TuningValues choose_values(TunedTable table, const MakeSubject& make, const TuneOptions& options) {
  return Tuner(table, make, options).run();
}

}  // namespace ubs::bench
