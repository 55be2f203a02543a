// SPDX-License-Identifier: Apache-2.0
// Compiles the mathematics that all back ends share (kernels/math) as CUDA. Each thread computes one value,
// and the number of dimensions is UBS_N. A .cu file that needs the formulas includes this file once, inside
// namespace ubs::cuda and an unnamed namespace, so that files with different UBS_N can be linked together.
// Therefore system headers must be included before this file. Programs that are compiled at run time include
// this file first.

// clang-format off
#include "kernels/dialect/dialect.h"
#include "kernels/variant.h"
#include "kernels/limits.h"
#include "kernels/layout.h"
#include "kernels/loss_weights.h"
#include "kernels/dialect/entry.h"
#include "cuda_backend/intrinsics.cuh"
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
#include "kernels/math/cull.h"
#include "kernels/math/adam.h"
#include "kernels/math/loss.h"
#include "kernels/math/rng.h"
#include "kernels/math/mcmc.h"
// clang-format on
