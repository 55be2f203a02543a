// SPDX-License-Identifier: Apache-2.0
// Compiles the mathematics of the kernels for the host in double precision and for one N. CMake sets UBS_N
// and compiles the file that includes this header once per N.
#pragma once

#include <cmath>

// The kernels are concatenated in this order, and no header includes another.
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
#include "kernels/math/reach.h"
#include "kernels/math/splat.h"
#include "kernels/math/blend.h"
// clang-format on
