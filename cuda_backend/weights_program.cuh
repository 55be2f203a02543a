// SPDX-License-Identifier: Apache-2.0
// This program measures the weights of splats, that is, how much they affect the pixels. Its kernel is
// measure_weights.
// clang-format off
#include "kernels/gpu/words.h"
#include "kernels/gpu/exchange.h"
#include "kernels/gpu/tile.h"
#include "kernels/gpu/weights.cl"
// clang-format on
