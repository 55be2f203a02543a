// SPDX-License-Identifier: Apache-2.0
// Affine is the transformation of a node of a scene, as files with a hierarchy of nodes state it (glTF,
// OpenUSD). transform_splats() applies it to splats.
#pragma once

#include <optional>

#include "host/base/vector3.hpp"
#include "host/formats/imported_splats.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs {

// Affine maps the point p to linear p + move.
struct Affine {
  Matrix3 linear{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  Vec3 move{0, 0, 0};
};

// Returns the transformation that applies `inner` first.
Affine operator*(const Affine& outer, const Affine& inner);

// Returns the inverse, or nothing if the transformation is singular, for example because of a scale of 0.
std::optional<Affine> inverse(const Affine& affine);

// Returns whether all numbers are finite.
bool is_finite(const Affine& affine);
// Returns whether the last row of a 4 x 4 matrix is 0 0 0 1, except for rounding. The matrix is then affine.
bool is_affine_row(double a, double b, double c, double d);

// These functions return a translation, a scaling along the axes, and the rotation of a quaternion w x y z,
// which need not have unit length. If the length of the quaternion is 0, the result is not finite.
Affine translation(const Vec3& by);
Affine scaling(const Vec3& by);
Affine rotation(const std::array<double, 4>& quaternion);

// Returns the same transformation in axes that are rotated by 180 degrees about x.
Affine half_turned(const Affine& affine);

// Applies a transformation that is not singular: to positions and offset, to the covariances, and to the
// spherical harmonics, so that a splat has the same colour seen along the transformed direction. This is
// exact for rotations, reflections and uniform scales. For other transformations the covariances are exact,
// too, but no spherical harmonics of the same degree describe the colours. Then the harmonics are rotated by
// the nearest rotation, and the report gets a note. A linear part that differs from the identity by no more
// than rounding leaves all bits as they are, except those of the offset.
void transform_splats(ImportedSplats& splats, const Affine& affine);

}  // namespace ubs
