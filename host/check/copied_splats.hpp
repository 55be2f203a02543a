// SPDX-License-Identifier: Apache-2.0
// judge_copies() checks the splats after a relocation or a growth. The moved and copied splats must be as
// docs/method.md requires in section 4.3. Population holds the splats of such a test.
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
  // Makes `count` splats. All first moments are 1.5, all second moments are 2.5, and all raw opacities are
  // `raw_opacity`. The other parameters differ between splats and between rows.
  Population(const ParameterLayout& layout, std::uint32_t count, std::uint32_t capacity, float raw_opacity);

  std::size_t rows, opacity_row;
  std::uint32_t count, stride;
  std::vector<float> params, moment1, moment2;

  float& at(std::size_t row, std::uint32_t i) { return params[row * stride + i]; }
  float at(std::size_t row, std::uint32_t i) const { return params[row * stride + i]; }
  // Returns the index of the splat that splat i was copied from.
  std::uint32_t origin(std::uint32_t i) const { return static_cast<std::uint32_t>(at(0, i)); }
  double opacity(std::uint32_t i) const;
};

// Returns the opacity that `parts` equal splats must have to absorb together as much as one splat with the
// opacity `opacity`. The result is limited to the range that docs/method.md states in section 4.3.
double split_opacity(double opacity, double parts);

struct Copies {
  std::string problem;       // the first problem that was found, or empty
  double opacity_error = 0;  // largest relative error of the new opacity of a splat that was copied
  std::map<std::uint32_t, int> of_source;  // number of copies by the index of the splat that was copied
};
// Compares the splats before and after the operation. Each splat in `written` must be a complete copy of a
// splat. If a splat has n copies, its opacity must now be split_opacity(opacity, n + 1). The moments of the
// copies and of the splats that were copied must be 0. All other values must be unchanged.
Copies judge_copies(const Population& before, const Population& after,
                    const std::vector<std::uint32_t>& written);

}  // namespace ubs::check
