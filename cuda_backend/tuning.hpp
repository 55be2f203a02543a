// SPDX-License-Identifier: Apache-2.0
// The tuned constants of the CUDA back end (host/device/tuning.hpp): structures of which none is the best
// everywhere. But for the backward rasteriser by splats all of them give the same bits.
#pragma once

#include "host/device/tuning.hpp"

namespace ubs::cuda {

// How the rasterisers hand tiles to blocks (tile_turns.cuh): the sum of these. 0: tile n is block n's.
constexpr unsigned kLongestFirst = 1;    // tiles with long lists begin
constexpr unsigned kResidentBlocks = 2;  // as many blocks as the card holds, each takes tile after tile
constexpr std::string_view kForwardTurns = "UBS_FORWARD_TURNS", kBackwardTurns = "UBS_BACKWARD_TURNS";
// Threads of a block of the kernels of kernels/map.
constexpr std::string_view kTunedMapBlock = "UBS_MAP_BLOCK";

const std::vector<TunedConstant>& tuned_constants();

}  // namespace ubs::cuda
