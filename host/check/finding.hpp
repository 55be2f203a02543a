// SPDX-License-Identifier: Apache-2.0
// Finding is the result of a device check for one stage. It contains an error and the largest error that is
// allowed.
#pragma once

#include <string>
#include <vector>

namespace ubs::check {

struct Finding {
  // `quantity` is the one with the largest ratio of error to bound. If `error` is infinite, `quantity` is a
  // text that states what is wrong.
  std::string stage, quantity;
  double error = 0, bound = 0;  // at most `bound` is allowed
  bool holds() const { return error <= bound; }
};
using Findings = std::vector<Finding>;

// WorstFinding collects the quantities of a stage and keeps the one with the largest ratio of error to bound.
class WorstFinding {
 public:
  explicit WorstFinding(std::string stage) { worst_.stage = std::move(stage); }
  // If the error is not finite, calls refuse().
  void add(const std::string& quantity, double error, double bound);
  // Makes the finding fail with this text, which states what is wrong. An earlier failure with a bound of 0
  // is kept.
  void refuse(const std::string& problem);
  const Finding& finding() const { return worst_; }

 private:
  Finding worst_;
  double share_ = -1;
};

// Returns, for example, "projection: conic factor has an error of 1.00e-02, but at most 2.00e-05 is allowed".
// If the bound is 0, returns, for example, "lists: wrong slots: 3 instead of 0".
std::string text(const Finding& finding);

}  // namespace ubs::check
