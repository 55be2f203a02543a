// SPDX-License-Identifier: Apache-2.0
// Background describes what is behind the splats: a colour, or a sky whose colour depends on the direction
// (method.md 4.11).
#pragma once

#include <array>
#include <vector>

namespace ubs {

struct Background {
  enum class Learnt { no, colour, sky };
  std::array<double, 3> colour{0, 0, 0};  // 0 to 1; the colour of a sky is its mean over all directions
  // Coefficients of the spherical harmonics of degree 1 and 2 of a sky: 8 functions with 3 channels each.
  // Empty if the background is a single colour.
  std::vector<double> harmonics;
  Learnt learnt = Learnt::no;  // whether training optimises the colour or the sky, starting from `colour`
  bool automatic = false;      // true as long as `colour` has yet to be chosen from the data
  bool operator==(const Background&) const = default;
};
inline constexpr std::size_t kSkyHarmonics = 24;

}  // namespace ubs
