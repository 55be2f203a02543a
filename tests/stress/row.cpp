// SPDX-License-Identifier: Apache-2.0
#include "tests/stress/row.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <iostream>

namespace ubs::stress {
namespace {

// If the rounding of a known limit is larger than this, the ratio of error to rounding is not printed,
// because the gradient has too few correct digits.
constexpr double kFewDigits = 2e-4;

std::size_t started_rows = 0;

}  // namespace

DeviceRunner* Row::runner_ = nullptr;
const StressOptions* Row::options_ = nullptr;

void Row::use(DeviceRunner& runner, const StressOptions& options) { runner_ = &runner, options_ = &options; }
std::size_t Row::started() { return started_rows; }

Row::Row() { ++started_rows; }

Row::~Row() {
  if (cases_ == 0 && value_error_ == 0) return;
  std::string text;
  for (std::size_t i = 0; i < kOutcomes; ++i)
    if (outcomes_[i] > 0) text += fmt::format(" {} {},", outcomes_[i], to_string(static_cast<Outcome>(i)));
  text += fmt::format(" largest errors: value {:.1e}, gradient {:.1e}", value_error_, gradient_error_);
  for (const auto& [name, factor] : limit_factors_) text += fmt::format("; {}: {:.3g} r", name, factor);
  std::cout << std::string(Catch::getResultCapture().getCurrentTestName()) << "\n   " << text << std::endl;
}

Verdict Row::check_case(const Case& c) {
  const Verdict verdict = examine(c, runner());
  take(c, verdict);
  return verdict;
}

void Row::take(const Case& c, const Verdict& v) {
  ++cases_;
  ++outcomes_[static_cast<std::size_t>(v.outcome)];
  if (v.outcome != Outcome::undecided) {
    value_error_ = std::max(value_error_, v.value_error);
    gradient_error_ = std::max(gradient_error_, v.gradient_error);
  }
  if (v.outcome == Outcome::known) {
    double& factor = limit_factors_[v.limit];
    if (v.rounding > 0 && v.rounding < kFewDigits)
      factor = std::max(
          factor, (v.gradient_error - std::max(kPromise, kConditioning * v.gradient_floor)) / v.rounding);
  }
  INFO(fmt::format("{}: N = {}, {} splats, {}x{} pixels", c.name, c.model.dim, c.model.count, c.camera.width,
                   c.camera.height));
  if (v.outcome == Outcome::failed)
    FAIL_CHECK(v.problem);
  else
    SUCCEED();
}

void Row::check_error(double error, const std::string& what) {
  value_error_ = std::max(value_error_, error);
  INFO(what);
  CHECK(error <= kPromise);
}

}  // namespace ubs::stress
