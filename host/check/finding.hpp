// SPDX-License-Identifier: Apache-2.0
// What a check of a device found, one a stage: an error beside what it may be.
#pragma once

#include <string>
#include <vector>

namespace ubs::check {

struct Finding {
  std::string stage, quantity;  // the quantity with the largest share of what it may be
  double error = 0, bound = 0;  // infinite where a value is no number
  bool holds() const { return error <= bound; }
};
using Findings = std::vector<Finding>;

// Keeps the quantity of a stage that comes closest to its bound, or is farthest beyond it.
class Worst {
 public:
  explicit Worst(std::string stage) { worst_.stage = std::move(stage); }
  void add(const std::string& quantity, double error, double bound);
  const Finding& finding() const { return worst_; }

 private:
  Finding worst_;
  double share_ = -1;
};

// "projection: conic factor has an error of 1.0e-02, at most 2.0e-05 is right"
std::string text(const Finding& finding);

}  // namespace ubs::check
