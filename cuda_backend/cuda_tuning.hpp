// SPDX-License-Identifier: Apache-2.0
// The tuned constants of the CUDA back end (host/device/tuning.hpp): all of them give the same bits.
#pragma once

#include "host/device/tuning.hpp"

namespace ubs::cuda {

// Threads of a block of the kernels of kernels/map.
constexpr std::string_view kTunedMapBlock = "UBS_MAP_BLOCK";

const std::vector<TunedConstant>& tuned_constants();

}  // namespace ubs::cuda
