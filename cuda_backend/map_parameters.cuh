// SPDX-License-Identifier: Apache-2.0
// The other kernels of kernels/map that depend on the variant of a model, as CUDA: Adam, penalties,
// relocation, noise.
// clang-format off
#include "kernels/map/adam_row.h"
#include "kernels/map/adam.cl"
#include "kernels/map/mcmc.cl"
#include "kernels/map/noise.cl"
#include "kernels/map/regularise.cl"
// clang-format on
