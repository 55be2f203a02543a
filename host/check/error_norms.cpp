// SPDX-License-Identifier: Apache-2.0
#include "host/check/error_norms.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "host/base/error.hpp"

namespace ubs::check {

void ErrorSum::add(double value, double truth) {
  double difference = std::abs(value - truth);
  if (!std::isfinite(difference)) difference = std::numeric_limits<double>::infinity();
  difference_ += difference * difference;
  norm_ += truth * truth;
  most_ = std::max(most_, difference);
}

void ErrorSum::add(std::span<const float> values, std::span<const double> truth) {
  if (values.size() != truth.size())
    fail(ErrorKind::internal, "cannot compare {} values with {} reference values", values.size(),
         truth.size());
  for (std::size_t i = 0; i < values.size(); ++i) add(values[i], truth[i]);
}

void ErrorSum::add(std::span<const float> planes, std::span<const double> truth,
                   std::span<const std::uint8_t> undecided) {
  if (undecided.empty()) return add(planes, truth);
  for (std::size_t i = 0; i < planes.size(); ++i)
    if (!undecided[i % undecided.size()]) add(planes[i], truth[i]);
}

Errors ErrorSum::errors() const {
  const double relative = std::sqrt(norm_ > 0 ? difference_ / norm_ : difference_);
  return {relative, most_, relative};
}

namespace {

// Returns the relative error without the worst 1 % of the splats. Both arrays have rows of `count` values,
// one per splat.
double without_worst_splats(std::span<const float> values, std::span<const double> truth, std::size_t count) {
  std::vector<double> by_splat(count, 0.0);
  double norm = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double difference = values[i] - truth[i];
    // A splat with a value that is not finite must not be among the omitted splats.
    if (!std::isfinite(difference)) return std::numeric_limits<double>::infinity();
    by_splat[i % count] += difference * difference;
    norm += truth[i] * truth[i];
  }
  const auto kept = static_cast<std::ptrdiff_t>(count - count / 100);
  std::ranges::nth_element(by_splat, by_splat.begin() + (kept - 1));
  const double sum = std::accumulate(by_splat.begin(), by_splat.begin() + kept, 0.0);
  return std::sqrt(norm > 0 ? sum / norm : sum);
}

}  // namespace

std::vector<NamedErrors> group_errors(const ParameterLayout& layout, std::size_t count,
                                      std::span<const float> values, std::span<const double> truth) {
  std::vector<NamedErrors> all;
  for (const ParameterGroup& group : parameter_groups(layout)) {
    if (group.count == 0) continue;
    const std::size_t first = static_cast<std::size_t>(group.first) * count;
    const std::size_t size = static_cast<std::size_t>(group.count) * count;
    ErrorSum sum;
    sum.add(values.subspan(first, size), truth.subspan(first, size));
    Errors errors = sum.errors();
    if (count > 0)
      errors.typical = without_worst_splats(values.subspan(first, size), truth.subspan(first, size), count);
    all.push_back({group.name, errors});
  }
  return all;
}

const NamedErrors& worst(std::span<const NamedErrors> errors) {
  return *std::ranges::max_element(errors, {}, [](const NamedErrors& e) { return e.errors.typical; });
}

}  // namespace ubs::check
