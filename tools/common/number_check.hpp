// SPDX-License-Identifier: Apache-2.0
// These functions make range checks for options that are numbers. They replace CLI11's checks, which print
// the largest double with all its digits and accept NaN.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <string>
#include <type_traits>

namespace ubs::tools {

// The range includes both ends.
template <typename Number>
CLI::Validator from_to(Number least, Number most) {
  constexpr bool kWhole = std::is_integral_v<Number>;
  return CLI::Validator(
      [=](std::string& text) {
        Number value{};
        if (CLI::detail::lexical_cast(text, value) && value >= least && value <= most) return std::string();
        return fmt::format("expected a {}number from {} to {}, not {}", kWhole ? "whole " : "", least, most,
                           text);
      },
      fmt::format("{} in [{} - {}]", kWhole ? "INT" : "FLOAT", least, most));
}

inline CLI::Validator above_zero(bool or_zero) {
  return CLI::Validator(
      [=](std::string& text) {
        double value = 0;
        if (CLI::detail::lexical_cast(text, value) && std::isfinite(value) &&
            (or_zero ? value >= 0 : value > 0))
          return std::string();
        return fmt::format("expected a number {}, not {}", or_zero ? "of 0 or more" : "above 0", text);
      },
      or_zero ? "NONNEGATIVE" : "POSITIVE");
}

inline CLI::Validator not_negative() { return above_zero(true); }
inline CLI::Validator positive() { return above_zero(false); }

}  // namespace ubs::tools
