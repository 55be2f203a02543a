// SPDX-License-Identifier: Apache-2.0
// Splats that are moved and copied by relocation and growth, and whether what came of it is what method.md
// 4.3 says.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "host/scene/splat_model.hpp"

namespace ubs::check {

// Raw parameters and moments in rows of `stride`. Row 0 of a splat is its own index, so that copies show
// where they come from.
struct Population {
  // Moments are 1.5 and 2.5 everywhere; parameters differ from splat to splat and row to row.
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
  std::string problem;       // the first one; empty: there is none
  double opacity_error = 0;  // largest relative error of a source's new opacity
  std::map<std::uint32_t, int> of_source;
};
// Every slot of `written` must be a complete copy of a splat that is now one of copies + 1 equal parts, all
// of them with moments of 0; everything else must be as it was.
Copies judge_copies(const Population& before, const Population& after,
                    const std::vector<std::uint32_t>& written);

}  // namespace ubs::check
