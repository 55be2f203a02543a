// SPDX-License-Identifier: Apache-2.0
// Splats of other tools, as their files have them: positions, Gaussian (or, for DBS, support) axes,
// rotations, opacities, spherical harmonics. What the importers read, what the writers of foreign formats
// take, and all that an exact Gaussian + SH rasteriser would need.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "host/data/load_report.hpp"
#include "host/scene/model_variant.hpp"

namespace ubs {

struct ImportedSplats {
  SpatialKernel kernel = SpatialKernel::gaussian;
  int sh_degree = 0;  // 0 to 4
  std::vector<std::array<float, 3>> positions;
  std::vector<std::array<float, 3>> log_scales;  // ln of sigma (gaussian) or of the support radius (beta)
  std::vector<std::array<float, 4>> rotations;   // unit quaternions w x y z
  std::vector<float> opacity_logits;             // in [-kMaxLogit, kMaxLogit]
  // Per splat (sh_degree + 1)^2 coefficients of 3 channels: [splat][coefficient][channel].
  std::vector<float> sh;
  int lobes = 0;          // spherical Beta lobes, 0 to 3
  std::vector<float> sb;  // [splat][field][lobe], six fields: raw r, g, b, theta, phi, beta (method.md 5.2)
  std::vector<float> betas;               // raw b_x, kernel = 4 exp(b); empty for Gaussians
  bool antialiased = false;               // trained with the 2D filter's opacity compensation
  std::array<double, 3> offset{0, 0, 0};  // world = local + offset
  LoadReport report;

  std::size_t count() const { return positions.size(); }
  std::size_t lobe_values() const { return 6 * static_cast<std::size_t>(lobes); }
  std::size_t coefficients() const {
    return static_cast<std::size_t>(sh_degree + 1) * static_cast<std::size_t>(sh_degree + 1);
  }
  void resize(std::size_t count);  // sets the size of every array from sh_degree, lobes and kernel
};

inline constexpr float kMaxLogit = 16;  // sigmoid rounds to 1 in float32 beyond it
// The log scale of a flat axis. A file may say -inf or any smaller number; e^-39 is 1e-17, whose square
// float32 still holds, and the formulas raise it to their least share of the largest scale
// (kernels/limits.h).
inline constexpr float kFlatLogScale = -39;
inline constexpr double kShC0 = 0.28209479177387814;  // 1 / (2 sqrt(pi))

// Adds splats of the same kernel and lobes behind these, and what was skipped and noted of them. The
// harmonics get the higher of the two degrees.
void append(ImportedSplats& splats, const ImportedSplats& more);

// Keeps the splats from `first` on, `count` of them.
ImportedSplats part_of(const ImportedSplats& splats, std::size_t first, std::size_t count);

// Sets the positions, one vector of coordinates an axis. Where they are so far from the origin that float32
// would round them, they become relative to a whole-numbered offset, which is added to `splats.offset`, and a
// note says so.
void place(ImportedSplats& splats, const std::array<std::vector<double>, 3>& coordinates);

// Normalises the quaternions, limits the opacities, raises vanishing scales to kFlatLogScale (such splats are
// discs), and drops splats that no renderer could show: non-finite values, zero quaternions, absurd scales.
// Counted in the report.
void clean(ImportedSplats& splats);

}  // namespace ubs
