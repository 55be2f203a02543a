// SPDX-License-Identifier: Apache-2.0
#include "host/check/copied_splats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ubs::check {
namespace {

constexpr float kMoment1 = 1.5f, kMoment2 = 2.5f;

bool moments_are(const Population& p, std::uint32_t i, float first, float second) {
  for (std::size_t k = 0; k < p.rows; ++k)
    if (p.moment1[k * p.stride + i] != first || p.moment2[k * p.stride + i] != second) return false;
  return true;
}

bool same_rows(const Population& a, std::uint32_t i, const Population& b, std::uint32_t j, bool opacity) {
  for (std::size_t k = 0; k < a.rows; ++k)
    if ((opacity || k != a.opacity_row) && a.at(k, i) != b.at(k, j)) return false;
  return true;
}

}  // namespace

Population::Population(const ParameterLayout& layout, std::uint32_t count_, std::uint32_t capacity,
                       float raw_opacity)
    : rows(static_cast<std::size_t>(layout.count)),
      opacity_row(static_cast<std::size_t>(layout.opacity)),
      count(count_),
      stride((capacity + 63) / 64 * 64),
      params(rows * stride),
      moment1(rows * stride, kMoment1),
      moment2(rows * stride, kMoment2) {
  for (std::size_t k = 0; k < rows; ++k)
    for (std::uint32_t i = 0; i < count; ++i)
      at(k, i) = static_cast<float>(k) + static_cast<float>(i) * 0.001f;
  for (std::uint32_t i = 0; i < count; ++i)
    at(0, i) = static_cast<float>(i), at(opacity_row, i) = raw_opacity;
}

double Population::opacity(std::uint32_t i) const {
  return 1 / (1 + std::exp(-static_cast<double>(at(opacity_row, i))));
}

double split_opacity(double opacity, double parts) {
  return std::clamp(1 - std::pow(1 - opacity, 1 / parts), 0.005, 1 - std::ldexp(1.0, -23));
}

Copies judge_copies(const Population& before, const Population& after,
                    const std::vector<std::uint32_t>& written) {
  Copies copies;
  const auto require = [&](bool holds, const char* what, std::uint32_t splat) {
    if (!holds && copies.problem.empty()) copies.problem = fmt::format("splat {} {}", splat, what);
    return holds;
  };
  for (const std::uint32_t slot : written) {
    // The value is only an index if the kernel has written the slot; otherwise it may be any number.
    const float origin = after.at(0, slot);
    if (!require(origin >= 0 && origin < static_cast<float>(before.count),
                 "is not a copy of an existing splat", slot))
      return copies;
    ++copies.of_source[after.origin(slot)];
    require(moments_are(after, slot, 0, 0), "is a copy, but its moments are not 0", slot);
    require(same_rows(after, slot, after, after.origin(slot), true), "is a copy, but differs from its source",
            slot);
  }
  for (std::uint32_t i = 0; i < before.count; ++i) {
    if (const auto source = copies.of_source.find(i); source != copies.of_source.end()) {
      const double expected = split_opacity(before.opacity(i), source->second + 1);
      const double error = std::abs(after.opacity(i) / expected - 1);
      // This form of the maximum also stores a NaN.
      copies.opacity_error = error <= copies.opacity_error ? copies.opacity_error : error;
      require(moments_are(after, i, 0, 0), "was copied, but its moments were not reset", i);
      require(same_rows(before, i, after, i, false), "was copied, but its position or shape changed", i);
    } else if (std::ranges::find(written, i) == written.end()) {
      require(same_rows(before, i, after, i, true) && moments_are(after, i, kMoment1, kMoment2),
              "changed, although it was neither moved nor copied", i);
    }
  }
  return copies;
}

}  // namespace ubs::check
