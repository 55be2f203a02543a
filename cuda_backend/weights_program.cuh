// SPDX-License-Identifier: Apache-2.0
// What splats do to pixels, as a program of its own: measure_weights.
// clang-format off
#include "kernels/gpu/words.h"
#include "kernels/gpu/exchange.h"
#include "kernels/gpu/tile.h"
#include "kernels/gpu/weights.cl"
// clang-format on
