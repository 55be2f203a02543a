// SPDX-License-Identifier: Apache-2.0
// The shared map kernels as CUDA: the same mathematics and the same kernel files as on OpenCL, one lane a
// thread, specialised for UBS_N. nvcc also checks what OpenCL C lets pass, such as argument types.
#define UBS_VW 1

// clang-format off
#include "kernels/dialect/dialect.h"
#include "kernels/variant.h"
#include "kernels/limits.h"
#include "kernels/layout.h"
#include "kernels/dialect/entry.h"
#include "kernels/math/elementary.h"
#include "kernels/math/rotation.h"
#include "kernels/math/covariance.h"
#include "kernels/math/conditional.h"
#include "kernels/math/projection.h"
#include "kernels/math/colour.h"
#include "kernels/math/splat.h"
#include "kernels/math/blend.h"
#include "kernels/math/adam.h"
#include "kernels/math/loss.h"
#include "kernels/math/rng.h"
#include "kernels/math/mcmc.h"

#include "kernels/map/records.h"
#include "kernels/map/project.cl"
#include "kernels/map/adam.cl"
#include "kernels/map/regularise.cl"
#include "kernels/map/mcmc.cl"
#include "kernels/map/noise.cl"
// clang-format on
