// SPDX-License-Identifier: Apache-2.0
// This file defines the weights of the loss (method.md 4.1) as kernel arguments. To add a term, add its weight here, its
// formula to math/loss.h (terms of the image) or math/adam.h (penalties of parameters), and the setting that it comes
// from to host/train/target_loss.hpp. The functions of host/device/loss_weights.hpp do not compile until they know it.
#pragma once

typedef struct {
  float l1, dssim;  // weights of the mean |I - T| and of 1 - SSIM
} LossWeights;

typedef struct {
  float opacity, scale;  // weights of the mean base opacity and of the mean spatial scale
} PenaltyWeights;
