// SPDX-License-Identifier: Apache-2.0
// Row is the fixture of the stress tests. A row is a test case, TEST_CASE_METHOD(Row, ...), that checks
// several cases (case.hpp) of one difficult or extreme situation on the device that the command line selects.
// At its end, it prints the number of cases with each outcome and the largest errors to std::cout. The
// reporters of Catch2 include this text in their JUnit and XML files.
#pragma once

#include <array>
#include <map>
#include <string>

#include "tests/stress/judge.hpp"

namespace ubs::stress {

// The options of `ubs-lab stress`.
struct StressOptions {
  std::string device, raster = "auto";
  // The random cases that are tested have this seed and the numbers from `first` to `first` + `cases` - 1.
  std::int64_t seed = 1, first = 0, cases = 3000;
};

class Row {
 public:
  // Sets the objects that all rows use. Both references must outlive the test run.
  static void use(DeviceRunner& runner, const StressOptions& options);
  // Returns how many rows have been started.
  static std::size_t started();

  Row();
  ~Row();
  DeviceRunner& runner() { return *runner_; }
  Device& device() { return runner_->device(); }
  const StressOptions& options() { return *options_; }

  // Renders the case, compares it with float64, and counts the result as take() does.
  Verdict check_case(const Case& c);
  // Adds the verdict to the counts and to the largest errors. The test case fails if the outcome is `failed`.
  void take(const Case& c, const Verdict& verdict);
  // Checks an error that the caller has computed, for example of the loss. The test case fails if it is
  // larger than kPromise. `what` names the compared value in the message.
  void check_error(double error, const std::string& what);
  std::size_t count(Outcome outcome) const { return outcomes_[static_cast<std::size_t>(outcome)]; }

 private:
  static DeviceRunner* runner_;
  static const StressOptions* options_;
  std::array<std::size_t, kOutcomes> outcomes_{};
  std::size_t cases_ = 0;
  double value_error_ = 0, gradient_error_ = 0;  // largest errors of the decided cases
  // For each known limit (known_limits.hpp): the largest excess of a gradient error over the error that is
  // allowed without the limit, divided by Verdict::rounding.
  std::map<std::string, double> limit_factors_;
};

}  // namespace ubs::stress
