// SPDX-License-Identifier: Apache-2.0
// ErrorSum measures the difference between float32 results and float64 results.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs::check {

struct Errors {
  double relative = 0;  // ||a - b|| / ||b|| (2-norm); ||a|| if b is zero
  double absolute = 0;  // max |a - b|
  // The relative error without the 1 % of splats that differ most, if the quantity has values for each splat.
  // Otherwise it is equal to `relative`. In float32, a few pairs of splats are in a different order than in
  // float64, and then their gradients are completely different. The error is infinite if any value is not
  // finite.
  double typical = 0;
};

// ErrorSum adds up the differences of a quantity, value by value. A value that is not finite makes all
// results infinite.
class ErrorSum {
 public:
  void add(double value, double truth);
  void add(std::span<const float> values, std::span<const double> truth);  // both of the same length
  // Adds planes of pixels, without the pixels in `undecided` (Problem::undecided).
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

// Returns the errors of each parameter group of the model. Groups without rows are omitted. `values` and
// `truth` have rows of `count` values.
std::vector<NamedErrors> group_errors(const ParameterLayout& layout, std::size_t count,
                                      std::span<const float> values, std::span<const double> truth);
// Returns the entry with the largest typical error. The list must not be empty.
const NamedErrors& worst(std::span<const NamedErrors> errors);

}  // namespace ubs::check
