// SPDX-License-Identifier: Apache-2.0
// The weights of the loss (method.md 4.1), as the host gives them to kernels. The formula of a term that has its weight
// here is in math/loss.h (terms of the image) or math/adam.h (penalties of parameters), its setting in
// host/device/loss_weights.hpp.
#pragma once

typedef struct {
  float l1, dssim;  // of the mean |I - T|, and of 1 - SSIM
} LossWeights;

typedef struct {
  float opacity, scale;  // of the mean base opacity, and of the mean spatial scale
} PenaltyWeights;
