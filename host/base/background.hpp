// SPDX-License-Identifier: Apache-2.0
// Background describes what is behind the splats: a colour, or a sky whose colour depends on the direction
// (method.md 4.11).
#pragma once

#include <array>
#include <vector>

namespace ubs {

struct Background {
  enum class Learnt { no, colour, sky };
  std::array<double, 3> colour{0, 0, 0};  // 0 to 1; for a sky the mean over all directions
  std::vector<double> harmonics;  // 24 numbers of degree 1 and 2, by function and channel; empty: no sky
  Learnt learnt = Learnt::no;     // whether it is trained, starting from `colour`
  bool automatic = false;         // `colour` has not yet been chosen from the data
  bool operator==(const Background&) const = default;
};
inline constexpr std::size_t kSkyHarmonics = 24;

}  // namespace ubs
