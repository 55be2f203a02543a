// SPDX-License-Identifier: Apache-2.0
// Row is the fixture of the stress test cases. A row is a TEST_CASE_METHOD(Row, ...) that checks cases of one
// difficult or extreme situation on the device of the command line. At its end, it prints the number of cases
// with each outcome and the largest errors to std::cout. The reporters of Catch2 include this text in their
// JUnit and XML files.
#pragma once

#include <array>
#include <map>
#include <string>

#include "tests/stress/judge.hpp"

namespace ubs::stress {

// The options of the command line of run_stress.
struct StressOptions {
  std::string device, raster = "auto";
  // Random cases from `first` to `first` + `cases` - 1 of the seed.
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
  // Counts the verdict. A verdict `failed` fails the test case.
  void take(const Case& c, const Verdict& verdict);
  // Checks an error of a comparison other than that of images. The test case fails if `error` is above
  // kPromise.
  void check_error(double error, const std::string& what);
  std::size_t count(Outcome outcome) const { return outcomes_[static_cast<std::size_t>(outcome)]; }

 private:
  static DeviceRunner* runner_;
  static const StressOptions* options_;
  std::array<std::size_t, kOutcomes> outcomes_{};
  std::size_t cases_ = 0;
  double value_error_ = 0, gradient_error_ = 0;  // largest errors of the decided cases
  // Largest (gradient error - allowed error) / rounding, by limit.
  std::map<std::string, double> limit_factors_;
};

}  // namespace ubs::stress
