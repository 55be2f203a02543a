// SPDX-License-Identifier: Apache-2.0
// ImportedSplats contains third-party splats in the parameters that their files store: positions, lengths of
// the axes (of the Gaussian, or of the support for DBS), rotations, opacities and spherical harmonics. The
// readers of third-party formats return this struct, and the writers take it as their input.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "host/scene/load_report.hpp"
#include "host/scene/model_variant.hpp"

namespace ubs {

struct ImportedSplats {
  SpatialKernel kernel = SpatialKernel::gaussian;
  int sh_degree = 0;  // 0 to 4
  std::vector<std::array<float, 3>> positions;
  // Logarithms of the standard deviations along the axes (kernel gaussian) or of the radii of the support
  // (beta).
  std::vector<std::array<float, 3>> log_scales;
  std::vector<std::array<float, 4>> rotations;  // unit quaternions w x y z
  std::vector<float> opacity_logits;            // in [-kMaxLogit, kMaxLogit]
  // Coefficients of the spherical harmonics, indexed by [splat][coefficient][channel]. A splat has
  // (sh_degree + 1)^2 coefficients for each of the 3 channels.
  std::vector<float> sh;
  int lobes = 0;  // number of spherical Beta lobes per splat, 0 to 3
  // Parameters of the lobes, indexed by [splat][field][lobe]. The six fields are the raw values of r, g, b,
  // theta, phi and beta (method.md 5.2).
  std::vector<float> sb;
  // Raw parameter b of each Beta kernel, whose exponent is 4 exp(b). Empty for Gaussians.
  std::vector<float> betas;
  // If true, writers do not change the order, because other files contain the same splats in this order.
  bool keep_order = false;
  bool antialiased = false;  // the splats were trained with the opacity compensation of the 2D filter
  std::array<double, 3> offset{0, 0, 0};  // world position = position + offset
  LoadReport report;

  std::size_t count() const { return positions.size(); }
  std::size_t lobe_values() const { return 6 * static_cast<std::size_t>(lobes); }
  std::size_t coefficients() const {
    return static_cast<std::size_t>(sh_degree + 1) * static_cast<std::size_t>(sh_degree + 1);
  }
  // Sets the size of every array from `count`, sh_degree, lobes and kernel.
  void resize(std::size_t count);
};

// Maximum absolute value of an opacity logit. The opacity of this logit differs from 1 by 1.1e-7.
inline constexpr float kMaxLogit = 16;
// Log scale of an axis along which a splat is flat. clean() raises smaller log scales of a file, including
// -inf, to this value. e^-39 is 1e-17, and its square can still be represented in float32. When a splat is
// rendered, such a scale is raised to a minimum fraction of the splat's largest scale (kernels/limits.h).
inline constexpr float kFlatLogScale = -39;
inline constexpr double kShC0 = 0.28209479177387814;  // 1 / (2 sqrt(pi))

// Appends splats with the same kernel and number of lobes, and the entries of their report. If the degrees of
// the spherical harmonics differ, the lower degree is raised by adding zeros. If the offsets differ, the
// positions of the appended splats become relative to the offset of `splats`.
void append(ImportedSplats& splats, const ImportedSplats& more);

// Returns `count` splats starting at `first`.
ImportedSplats part_of(const ImportedSplats& splats, std::size_t first, std::size_t count);

using Coordinates = std::array<std::vector<double>, 3>;  // one vector per axis

// Sets the positions from the coordinates. If they are so far from the origin that rounding to float32 would
// be visible, they are stored relative to an offset of whole numbers. In this case, the offset is added to
// `splats.offset`, and the report gets a note.
void place(ImportedSplats& splats, const Coordinates& coordinates);

// Adds the offset to the positions and sets it to zero, unless the splats are then so far from the origin
// that rounding to float32 would be visible.
void apply_offset(ImportedSplats& splats);

// Normalises the quaternions, clamps the opacity logits, and raises log scales below kFlatLogScale to this
// value, which makes these splats discs. Drops splats that cannot be rendered, because they have values that
// are not finite, zero quaternions, or extreme scales, colours or Beta parameters, and counts them in the
// report.
void clean(ImportedSplats& splats);

}  // namespace ubs
