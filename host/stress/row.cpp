// SPDX-License-Identifier: Apache-2.0
// See row.hpp.
#include "host/stress/row.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"

namespace ubs::stress {
namespace {

constexpr double kFewDigits = 2e-4;  // rounding from which an error is no multiple of it any more

void add_limit(LimitCount& limit, const Verdict& v) {
  ++limit.cases;
  limit.value_error = std::max(limit.value_error, v.value_error);
  limit.gradient_error = std::max(limit.gradient_error, v.gradient_error);
  if (!(v.rounding > 0 && v.rounding < kFewDigits)) return;
  const double value = v.value_error - std::max(kPromise, kConditioning * v.value_floor);
  const double gradient = v.gradient_error - std::max(kPromise, kConditioning * v.gradient_floor);
  limit.value_factor = std::max(limit.value_factor, value / v.rounding);
  limit.gradient_factor = std::max(limit.gradient_factor, gradient / v.rounding);
}

}  // namespace

void LimitCount::add(const LimitCount& other) {
  cases += other.cases;
  value_error = std::max(value_error, other.value_error);
  gradient_error = std::max(gradient_error, other.gradient_error);
  value_factor = std::max(value_factor, other.value_factor);
  gradient_factor = std::max(gradient_factor, other.gradient_factor);
}

Verdict RowRun::examine(const Case& c) {
  const Verdict verdict = stress::examine(c, runner_);
  take(c, verdict);
  return verdict;
}

void RowRun::take(const Case& c, const Verdict& v) {
  ++report_.cases;
  report_.drawn += v.drawn, report_.culled += v.culled;
  report_.pixels += v.pixels, report_.undecided += v.undecided;
  report_.finite = report_.finite && v.finite;
  if (v.outcome != Outcome::undecided) {
    report_.value_error = std::max(report_.value_error, v.value_error);
    report_.gradient_error = std::max(report_.gradient_error, v.gradient_error);
  }
  ++report_.outcomes[static_cast<std::size_t>(v.outcome)];
  if (v.outcome == Outcome::known) {
    add_limit(report_.limits[v.limit], v);
  }
  if (v.outcome == Outcome::failed && !report_.failing) {
    report_.failing = c;
    report_.verdict = v;
    note(fmt::format("{}: {}", c.name, v.problem));
  }
  report_.outcome = std::max(report_.outcome, v.outcome);
}

void RowRun::require(bool holds, const std::string& problem) {
  if (holds) return;
  report_.outcome = Outcome::failed;
  note(problem);
}

void RowRun::value_error(double error, double bound, const std::string& what) {
  report_.value_error = std::max(report_.value_error, error);
  report_.finite = report_.finite && std::isfinite(error);
  require(error <= bound, fmt::format("{}: error {:.2e} is above {:.2e}", what, error, bound));
}

void RowRun::note(const std::string& text) {
  if (report_.note.find(text) != std::string::npos) return;
  report_.note += (report_.note.empty() ? "" : "; ") + text;
}

std::vector<Row> all_rows() {
  std::vector<Row> rows;
  for (auto part : {render_rows, view_rows, image_rows, training_rows, property_rows})
    std::ranges::move(part(), std::back_inserter(rows));
  std::ranges::sort(rows, {}, &Row::name);
  return rows;
}

RowReport run_row(const Row& row, DeviceRunner& runner) {
  RowReport report;
  report.name = row.name, report.what = row.what;
  const Stopwatch watch;
  RowRun run(runner, report);
  try {
    row.run(run);
  } catch (const std::exception& error) {
    run.require(false, error.what());
  }
  report.seconds = watch.seconds();
  return report;
}

}  // namespace ubs::stress
