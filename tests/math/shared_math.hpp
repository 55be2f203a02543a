// SPDX-License-Identifier: Apache-2.0
// The kernels' mathematics compiled for the host in double precision, for one N (UBS_N, set by CMake:
// the file that includes this is compiled once per N).
#pragma once

#include <cmath>

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
