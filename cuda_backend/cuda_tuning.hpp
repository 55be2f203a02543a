// SPDX-License-Identifier: Apache-2.0
// The tuned constants of the CUDA back end (host/device/tuning.hpp). Results are bit-identical for all of
// their values.
#pragma once

#include "host/device/tuning.hpp"

namespace ubs::cuda {

// Number of threads per block of the kernels of kernels/map.
constexpr std::string_view kTunedMapBlock = "UBS_MAP_BLOCK";

const std::vector<TunedConstant>& tuned_constants();

}  // namespace ubs::cuda
