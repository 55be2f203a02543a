// SPDX-License-Identifier: Apache-2.0
// Declares the tuned constants of the CUDA back end (host/device/tuning.hpp). Results are bit-identical for
// all values of these constants.
#pragma once

#include "host/device/tuning.hpp"

namespace ubs::cuda {

// Number of threads per block of the projection kernels and of the kernels that change the parameters of
// splats (map_block() in cuda_projection.hpp). All other kernels of kernels/map have kMapBlock threads.
constexpr std::string_view kTunedMapBlock = "UBS_MAP_BLOCK";

const std::vector<TunedConstant>& tuned_constants();

}  // namespace ubs::cuda
