// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/error_norms.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/base/error.hpp"

namespace ubs::accuracy {

void ErrorSum::add(double value, double truth) {
  double difference = std::abs(value - truth);
  if (!std::isfinite(difference)) difference = std::numeric_limits<double>::infinity();
  difference_ += difference * difference;
  norm_ += truth * truth;
  most_ = std::max(most_, difference);
}

void ErrorSum::add(std::span<const float> values, std::span<const double> truth) {
  if (values.size() != truth.size())
    fail(ErrorKind::internal, "{} values compared with {}", values.size(), truth.size());
  for (std::size_t i = 0; i < values.size(); ++i) add(values[i], truth[i]);
}

Errors ErrorSum::errors() const { return {std::sqrt(norm_ > 0 ? difference_ / norm_ : difference_), most_}; }

std::vector<NamedErrors> group_errors(const ParameterLayout& layout, std::size_t count, std::span<const float> values,
                                      std::span<const double> truth) {
  std::vector<NamedErrors> all;
  for (const ParameterGroup& group : parameter_groups(layout)) {
    if (group.count == 0) continue;
    const std::size_t first = static_cast<std::size_t>(group.first) * count;
    const std::size_t size = static_cast<std::size_t>(group.count) * count;
    ErrorSum sum;
    sum.add(values.subspan(first, size), truth.subspan(first, size));
    all.push_back({group.name, sum.errors()});
  }
  return all;
}

const NamedErrors& worst(std::span<const NamedErrors> errors) {
  return *std::ranges::max_element(errors, {}, [](const NamedErrors& e) { return e.errors.relative; });
}

}  // namespace ubs::accuracy
