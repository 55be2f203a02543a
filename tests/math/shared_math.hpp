// SPDX-License-Identifier: Apache-2.0
// Compiles the mathematics of the kernels (kernels/math) for the host, in double precision, for one number of
// dimensions (UBS_N) and one variant. CMake defines the macros for them, and compiles the files that include
// this header once for each combination.
#pragma once

#include <cmath>

// These headers do not include each other, so they must be included in this order.
// clang-format off
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"
#include "kernels/layout.h"
#include "kernels/loss_weights.h"
#include "kernels/math/elementary.h"
#include "kernels/math/rotation.h"
#include "kernels/math/covariance.h"
#include "kernels/math/conditional.h"
#include "kernels/math/direct.h"
#include "kernels/math/ellipse.h"
#include "kernels/math/projection.h"
#include "kernels/math/colour.h"
#include "kernels/math/falloff.h"
#include "kernels/math/reach.h"
#include "kernels/math/splat.h"
#include "kernels/math/blend.h"
// clang-format on
