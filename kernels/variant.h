// SPDX-License-Identifier: Apache-2.0
// Which form of the method is compiled (method.md 8; docs/variants.md). A macro that is not given takes
// its value 0, the published form; the values are those of the enumerations in
// host/scene/model_variant.hpp. What is not chosen is removed by the preprocessor.
#pragma once

#ifndef UBS_ROT_MODE
#define UBS_ROT_MODE 0
#endif
#define UBS_ROT_TAYLOR1 0
#define UBS_ROT_TAYLOR2 1
#define UBS_ROT_CAYLEY 2  // 3: exp
#define UBS_ROT_QUATERNION 4

#ifndef UBS_COV_PARAM
#define UBS_COV_PARAM 0  // spatial_ortho
#endif
#define UBS_COV_CHOLESKY 1
#define UBS_COV_SKEW_ND 2

#ifndef UBS_BETA_COND
#define UBS_BETA_COND 0
#endif
#define UBS_BETA_COND_ON 0
#define UBS_BETA_COND_OFF 1

#ifndef UBS_BETA_OPACITY
#define UBS_BETA_OPACITY 0
#endif
#define UBS_BETA_OPACITY_TANH 0
#define UBS_BETA_OPACITY_NONE 1
#define UBS_BETA_OPACITY_GAUSSIAN 2

#ifndef UBS_COV_MODE
#define UBS_COV_MODE 0
#endif
#define UBS_COV_WHITEN 1  // 0: upper

#ifndef UBS_FALLOFF  // the switch `kernel`
#define UBS_FALLOFF 0
#endif
#define UBS_FALLOFF_BETA 0
#define UBS_FALLOFF_GAUSSIAN 1

#ifndef UBS_COLOUR  // 0: rgb; 1 + l: spherical harmonics up to degree l <= 3; 4 + n: n <= 3 spherical Beta lobes
#define UBS_COLOUR 0
#endif

#ifndef UBS_ANTIALIAS
#define UBS_ANTIALIAS 0
#endif

#ifndef UBS_DIRECT  // the switch `conditioning`: 1 where what drawing needs is parameterised directly
#define UBS_DIRECT 0
#endif

// ---- What follows from the choices ----
// Lobes, and coefficients of a colour channel.
#define UBS_LOBES (UBS_COLOUR > 4 ? UBS_COLOUR - 4 : 0)
#define UBS_SH_COUNT (UBS_LOBES > 0 ? 1 : UBS_COLOUR * UBS_COLOUR)
enum {  // raw betas that exist: of the spatial kernel, of the query dimensions
  kHasSpatialBeta = UBS_FALLOFF == UBS_FALLOFF_BETA,
  kHasQueryBeta = (UBS_BETA_COND == UBS_BETA_COND_ON) | (UBS_BETA_OPACITY == UBS_BETA_OPACITY_TANH),
};

// The spatial kernel ends where the squared distance r reaches this. Gaussian: 3.33 standard deviations, where an
// opaque splat's alpha is below 1/255 (2 ln 255 = 11.083), so that alpha alone decides where a Gaussian ends.
#define UBS_SUPPORT (UBS_FALLOFF == UBS_FALLOFF_GAUSSIAN ? R(11.0889) : R(1.0))
#if UBS_FALLOFF > UBS_FALLOFF_GAUSSIAN
#error "UBS_FALLOFF: no such kernel"  // rather than one of the two, drawn without a word
#endif

// ---- Work that is left out (docs/variants.md) ----
#ifndef UBS_ALPHA_MIN  // contributions of alpha <= this are left out; 0: all count
#define UBS_ALPHA_MIN R(0.0)
#endif
// The least alpha that counts, if any, and with it the extents of splats by opacity.
#define UBS_LEAST_ALPHA \
  (kHasSpatialBeta || UBS_ALPHA_MIN > UBS_ALPHA_MIN_GAUSSIAN ? UBS_ALPHA_MIN : UBS_ALPHA_MIN_GAUSSIAN)
#define UBS_OPACITY_EXTENTS (UBS_LEAST_ALPHA > R(0.0))

#ifndef UBS_FORWARD_ONLY  // no masks, no slots, no backward kernels
#define UBS_FORWARD_ONLY 0
#endif
