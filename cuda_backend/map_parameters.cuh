// SPDX-License-Identifier: Apache-2.0
// Compiles the kernels of kernels/map that change the parameters of splats as CUDA: Adam steps, penalties,
// relocation and noise.
// clang-format off
#include "kernels/map/adam_row.h"
#include "kernels/map/adam.cl"
#include "kernels/map/mcmc.cl"
#include "kernels/map/noise.cl"
#include "kernels/map/regularise.cl"
// clang-format on
