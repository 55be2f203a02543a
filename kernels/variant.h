// SPDX-License-Identifier: Apache-2.0
// This header selects the variant of the method that is compiled (method.md 8; docs/variants.md). Each macro below
// chooses one option. A macro that is not defined gets the value 0, which is the published variant. The values are
// those of the enumerations in host/scene/model_variant.hpp. The preprocessor removes the code of all options that are
// not chosen.
#pragma once

#ifndef UBS_ROT_MODE
#define UBS_ROT_MODE 0
#endif
#define UBS_ROT_TAYLOR1 0
#define UBS_ROT_TAYLOR2 1
#define UBS_ROT_CAYLEY 2  // the value 3 is exp
#define UBS_ROT_QUATERNION 4

#ifndef UBS_COV_PARAM
#define UBS_COV_PARAM 0  // the value 0 is spatial_ortho
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
#define UBS_COV_WHITEN 1  // the value 0 is upper

#ifndef UBS_FALLOFF  // the setting `kernel`
#define UBS_FALLOFF 0
#endif
#define UBS_FALLOFF_BETA 0
#define UBS_FALLOFF_GAUSSIAN 1
// The user has defined the kernel by expressions (OwnFalloff of host/device/stages.hpp). The parameters of the model
// are those of the kernel beta. The number is negative, because the numbers from 0 on are those of the table of kernels
// (host/scene/spatial_kernel.hpp).
#define UBS_FALLOFF_OWN (-1)

// Representation of the colour. 0 is rgb. 1 to 4 are spherical harmonics up to degree 0 to 3. 5 to 7 are one to three
// spherical Beta lobes.
#ifndef UBS_COLOUR
#define UBS_COLOUR 0
#endif

#ifndef UBS_ANTIALIAS
#define UBS_ANTIALIAS 0
#endif

// The setting `conditioning`. If it is 1, the quantities that rendering needs are parameters themselves, so that no
// matrix is inverted (method.md 9).
#ifndef UBS_DIRECT
#define UBS_DIRECT 0
#endif

// ---- The spatial kernel ----
// Each kernel has a block of numbers here and a block of formulas in math/falloff.h:
//   UBS_KERNEL_HAS_BETA   1 if the model has a raw beta for the kernel
//   UBS_SUPPORT           the kernel ends where the squared distance r reaches this value
//   UBS_KERNEL_ALPHA_MAX  alpha is reduced to this value
//   UBS_KERNEL_ALPHA_MIN  contributions with alpha < this value are skipped; with 0, none are skipped
#if UBS_FALLOFF == UBS_FALLOFF_BETA
#define UBS_KERNEL_HAS_BETA 1
#define UBS_SUPPORT R(1.0)
#define UBS_KERNEL_ALPHA_MAX UBS_ALPHA_MAX
#define UBS_KERNEL_ALPHA_MIN R(0.0)
#elif UBS_FALLOFF == UBS_FALLOFF_GAUSSIAN
#define UBS_KERNEL_HAS_BETA 0
// 3.33 standard deviations. At this distance even the alpha of an opaque splat is below 1/255, because the value is
// larger than 2 ln 255 = 11.083. So only the limit of alpha determines where a Gaussian ends.
#define UBS_SUPPORT R(11.0889)
#define UBS_KERNEL_ALPHA_MAX UBS_ALPHA_MAX_GAUSSIAN
#define UBS_KERNEL_ALPHA_MIN UBS_ALPHA_MIN_GAUSSIAN
#elif UBS_FALLOFF == UBS_FALLOFF_OWN
#define UBS_KERNEL_HAS_BETA 1
#define UBS_SUPPORT UBS_OWN_SUPPORT
#define UBS_KERNEL_ALPHA_MAX UBS_ALPHA_MAX
#define UBS_KERNEL_ALPHA_MIN R(0.0)
#else
#error "UBS_FALLOFF: no such kernel"
#endif

// ---- Consequences of the choices ----
// Number of lobes, and number of coefficients per colour channel.
#define UBS_LOBES (UBS_COLOUR > 4 ? UBS_COLOUR - 4 : 0)
#define UBS_SH_COUNT (UBS_LOBES > 0 ? 1 : UBS_COLOUR * UBS_COLOUR)
enum {  // 1 if the model has a raw beta for the spatial kernel, and raw betas for the query dimensions
  kHasSpatialBeta = UBS_KERNEL_HAS_BETA,
  kHasQueryBeta = (UBS_BETA_COND == UBS_BETA_COND_ON) | (UBS_BETA_OPACITY == UBS_BETA_OPACITY_TANH),
};

// ---- Optional restrictions that save work (docs/variants.md) ----
#ifndef UBS_ALPHA_MIN  // contributions with alpha <= this value are skipped; with 0, none are skipped
#define UBS_ALPHA_MIN R(0.0)
#endif
// The smallest alpha that contributes, if there is a limit. With a limit, the extent of a splat depends on its opacity.
#define UBS_LEAST_ALPHA (UBS_ALPHA_MIN > UBS_KERNEL_ALPHA_MIN ? UBS_ALPHA_MIN : UBS_KERNEL_ALPHA_MIN)
#define UBS_OPACITY_EXTENTS (UBS_LEAST_ALPHA > R(0.0))

// If UBS_ABSGRAD is 1, the gradient of a splat's position in the image is replaced by a sum of absolute values. The sum
// is that of the absolute contributions of all pixels to the gradient, for x and y separately. It is used as a
// criterion for densification (AbsGS, Ye et al. 2024). Images with more than three channels are rendered in several
// passes, but a contribution is that of all channels together. So the backward pass can get the values of the further
// channels (RasterBackward::more_colours in host/device/stages.hpp).
#ifndef UBS_ABSGRAD
#define UBS_ABSGRAD 0
#endif

#ifndef UBS_FORWARD_ONLY  // 1: compile only the forward pass, without masks, slots and backward kernels
#define UBS_FORWARD_ONLY 0
#endif
