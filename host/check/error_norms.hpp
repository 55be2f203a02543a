// SPDX-License-Identifier: Apache-2.0
// ErrorSum computes the errors of float32 results compared with float64 results.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs::check {

struct Errors {
  // In these formulas, a are the results and b are the float64 results.
  double relative = 0;  // ||a - b|| / ||b|| (2-norms), or ||a|| if b is zero
  double absolute = 0;  // max |a - b|
  // If the quantity has values for each splat, this is the relative error without the 1 % of splats that
  // differ most. These are omitted because in float32 a few pairs of splats are in another order than in
  // float64, so that their gradients are completely different. The error is infinite if any value is not
  // finite. For other quantities it is equal to `relative`.
  double typical = 0;
};

// ErrorSum adds up the differences between the values of a quantity and their true values. If a value is not
// finite, all errors are infinite.
class ErrorSum {
 public:
  void add(double value, double truth);
  void add(std::span<const float> values, std::span<const double> truth);  // both must have the same length
  // Adds the pixels of an image with several planes, except for the pixels whose entry in `undecided` is not
  // 0 (see Problem::undecided).
  void add(std::span<const float> planes, std::span<const double> truth,
           std::span<const std::uint8_t> undecided);
  Errors errors() const;

 private:
  double difference_ = 0, norm_ = 0, most_ = 0;
};

struct NamedErrors {
  std::string quantity;
  Errors errors;
};

// Returns the errors of each parameter group of the model. Groups without rows are omitted. The rows of
// `values` and `truth` have `count` values each, one per splat.
std::vector<NamedErrors> group_errors(const ParameterLayout& layout, std::size_t count,
                                      std::span<const float> values, std::span<const double> truth);
// Returns the entry with the largest typical error. The list must not be empty.
const NamedErrors& worst(std::span<const NamedErrors> errors);

}  // namespace ubs::check
