// SPDX-License-Identifier: Apache-2.0
// Finding is the result of a device check for one stage. It contains an error and the largest error that is
// allowed.
#pragma once

#include <string>
#include <vector>

namespace ubs::check {

struct Finding {
  std::string stage, quantity;  // `quantity` is the one with the largest ratio of error to bound
  double error = 0, bound = 0;  // `error` is infinite if a value is not finite; at most `bound` is allowed
  bool holds() const { return error <= bound; }
};
using Findings = std::vector<Finding>;

// Worst collects the quantities of a stage and keeps the one with the largest ratio of error to bound.
class Worst {
 public:
  explicit Worst(std::string stage) { worst_.stage = std::move(stage); }
  void add(const std::string& quantity, double error, double bound);
  const Finding& finding() const { return worst_; }

 private:
  Finding worst_;
  double share_ = -1;
};

// Returns, for example, "projection: conic factor has an error of 1.00e-02, but at most 2.00e-05 is allowed".
std::string text(const Finding& finding);

}  // namespace ubs::check
