// SPDX-License-Identifier: Apache-2.0
// distance() returns the distance between two points.
#pragma once

#include "host/base/vector3.hpp"

namespace ubs::test {

inline double distance(const Vec3& a, const Vec3& b) { return length(a - b); }

}  // namespace ubs::test
