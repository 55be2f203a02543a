// SPDX-License-Identifier: Apache-2.0
// ImportedSplats contains splats of other tools with the values that their files store: positions, axes (of
// the Gaussian, or of the support for DBS), rotations, opacities and spherical harmonics. Importers return
// this struct, and writers of third-party formats take it as their input. It contains all values that an
// exact rasteriser of Gaussians with spherical harmonics would need.
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
  // Raw b_x, where the exponent of the kernel is 4 exp(b). Empty for Gaussians.
  std::vector<float> betas;
  bool antialiased = false;               // trained with the opacity compensation of the 2D filter
  std::array<double, 3> offset{0, 0, 0};  // world = local + offset
  LoadReport report;

  std::size_t count() const { return positions.size(); }
  std::size_t lobe_values() const { return 6 * static_cast<std::size_t>(lobes); }
  std::size_t coefficients() const {
    return static_cast<std::size_t>(sh_degree + 1) * static_cast<std::size_t>(sh_degree + 1);
  }
  // Sets the size of every array from `count`, sh_degree, lobes and kernel.
  void resize(std::size_t count);
};

inline constexpr float kMaxLogit = 16;  // beyond it, sigmoid rounds to 1 in float32
// Log scale of a flat axis. A file may contain -inf or any smaller number. e^-39 is 1e-17; its square still
// fits into float32. The formulas raise such a scale to a minimum share of the largest scale
// (kernels/limits.h).
inline constexpr float kFlatLogScale = -39;
inline constexpr double kShC0 = 0.28209479177387814;  // 1 / (2 sqrt(pi))

// Appends splats of the same kernel and number of lobes, and the entries of their report. The harmonics get
// the higher of the two degrees.
void append(ImportedSplats& splats, const ImportedSplats& more);

// Returns `count` splats starting at `first`.
ImportedSplats part_of(const ImportedSplats& splats, std::size_t first, std::size_t count);

// Sets the positions from one vector of coordinates per axis. If they are so far from the origin that float32
// would round them, they are stored relative to an offset of whole numbers. The offset is added to
// `splats.offset`, and a note says so.
void place(ImportedSplats& splats, const std::array<std::vector<double>, 3>& coordinates);

// Normalises the quaternions, clamps the opacities, and raises vanishing scales to kFlatLogScale, which makes
// these splats discs. Drops splats that no renderer could show (non-finite values, zero quaternions, extreme
// scales) and counts them in the report.
void clean(ImportedSplats& splats);

}  // namespace ubs
