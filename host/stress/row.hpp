// SPDX-License-Identifier: Apache-2.0
// The rows of a stress run: named checks of one stiff or extreme situation each, and what came out of them.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "host/stress/judge.hpp"

namespace ubs::stress {

struct LimitCount {
  std::size_t cases = 0;
  double value_error = 0, gradient_error = 0;  // the largest
  // The largest above the promise, in units of the limit's rounding, where that is below 2e-4.
  double value_factor = 0, gradient_factor = 0;
  void add(const LimitCount& other);
};

struct RowReport {
  std::string name, what;
  Outcome outcome = Outcome::float64;             // the worst of its cases
  std::array<std::size_t, kOutcomes> outcomes{};  // compared cases by outcome
  std::map<std::string, LimitCount> limits;       // known limits that were met
  std::size_t cases = 0, drawn = 0, culled = 0;
  std::size_t pixels = 0, undecided = 0;
  double value_error = 0, gradient_error = 0;  // the largest of decided cases
  bool finite = true;
  double seconds = 0;
  std::string note;             // what was found beside numbers, or what is wrong
  std::optional<Case> failing;  // the first case that failed
  Verdict verdict;              // of `failing`
};

// What a row does its work with; collects the report.
class RowRun {
 public:
  RowRun(DeviceRunner& runner, RowReport& report) : runner_(runner), report_(report) {}

  DeviceRunner& runner() { return runner_; }
  // Draws the case, compares it, and takes the result into the report.
  Verdict examine(const Case& c);
  void take(const Case& c, const Verdict& verdict);
  // A promise that is no comparison of images; `problem` says what is wrong when it does not hold.
  void require(bool holds, const std::string& problem);
  void value_error(double error, double bound, const std::string& what);
  void note(const std::string& text);
  void count(std::size_t cases) { report_.cases += cases; }

 private:
  DeviceRunner& runner_;
  RowReport& report_;
};

struct Row {
  std::string name, what;
  std::function<void(RowRun&)> run;
};

// All rows in the order of their names.
std::vector<Row> all_rows();
std::vector<Row> render_rows();
std::vector<Row> view_rows();
std::vector<Row> image_rows();
std::vector<Row> training_rows();
std::vector<Row> property_rows();

// Runs a row; an exception is a failure with its message.
RowReport run_row(const Row& row, DeviceRunner& runner);

}  // namespace ubs::stress
