// SPDX-License-Identifier: Apache-2.0
// Two numbers for the difference of float32 results from float64 ones.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs::check {

struct Errors {
  double relative = 0;  // ||a - b|| / ||b|| (2-norm); ||a|| where b is zero
  double absolute = 0;  // max |a - b|
  // The relative error without the 1 % of splats that differ most, where the quantity is one of splats: in
  // float32 a few pairs of splats have another order than in float64, and their gradients are then others
  // altogether. Infinite where any value is not finite.
  double typical = 0;
};

// Sums of a quantity's differences, value by value. A value that is not finite makes both numbers infinite.
class ErrorSum {
 public:
  void add(double value, double truth);
  void add(std::span<const float> values, std::span<const double> truth);  // of one length
  // Planes of pixels, without those that are not decided (Problem::undecided).
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

// By parameter group of the model form, groups without rows left out. Both in rows of `count` values.
std::vector<NamedErrors> group_errors(const ParameterLayout& layout, std::size_t count,
                                      std::span<const float> values, std::span<const double> truth);
// The one with the largest typical error; the list must not be empty.
const NamedErrors& worst(std::span<const NamedErrors> errors);

}  // namespace ubs::check
