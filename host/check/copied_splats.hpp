// SPDX-License-Identifier: Apache-2.0
// judge_copies() checks splats after relocation or growth: the moved and copied splats must be as method.md
// 4.3 requires. Population holds the splats of such a test.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs::check {

// Population holds raw parameters and moments in rows of `stride` values. Row 0 of a splat contains its own
// index, so that a copy shows which splat it was copied from.
struct Population {
  // All first moments are 1.5 and all second moments 2.5. Parameters differ between splats and between rows.
  Population(const ParameterLayout& layout, std::uint32_t count, std::uint32_t capacity, float raw_opacity);

  std::size_t rows, opacity_row;
  std::uint32_t count, stride;
  std::vector<float> params, moment1, moment2;

  float& at(std::size_t row, std::uint32_t i) { return params[row * stride + i]; }
  float at(std::size_t row, std::uint32_t i) const { return params[row * stride + i]; }
  std::uint32_t origin(std::uint32_t i) const { return static_cast<std::uint32_t>(at(0, i)); }
  double opacity(std::uint32_t i) const;
};

// Returns the opacity of each of `parts` equal splats that together absorb as much as one of `opacity`,
// within the limits of method.md 4.3.
double split_opacity(double opacity, double parts);

struct Copies {
  std::string problem;       // the first problem that was found; empty: none
  double opacity_error = 0;  // largest relative error of a source's new opacity
  std::map<std::uint32_t, int> of_source;
};
// Checks that every slot in `written` is a complete copy of a splat, that this splat now has the opacity of
// one of copies + 1 equal parts, and that the moments of all of them are 0. Everything else must be
// unchanged.
Copies judge_copies(const Population& before, const Population& after,
                    const std::vector<std::uint32_t>& written);

}  // namespace ubs::check
