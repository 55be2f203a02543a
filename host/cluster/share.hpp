// SPDX-License-Identifier: Apache-2.0
// share_of() returns the contiguous range of splats of a model that a rank owns. It depends only on the
// number of splats and the number of ranks. The ranges consist of whole blocks. Therefore a vector in a
// kernel contains the same splats for any number of ranks. This is necessary for bit-identical results,
// because some kernels choose a code path that depends on all lanes of a vector, and the results of these
// paths may differ in the last bit.
#pragma once

#include <algorithm>
#include <cstdint>

namespace ubs {

inline constexpr std::uint32_t kShareBlock = 64;  // splats per block; a multiple of the lanes of a vector

struct Share {
  std::uint32_t first = 0, count = 0;
  std::uint32_t end() const { return first + count; }
};

inline Share share_of(std::uint32_t splats, int ranks, int rank) {
  const std::uint64_t blocks = (std::uint64_t{splats} + kShareBlock - 1) / kShareBlock;
  const auto edge = [&](int r) {
    const std::uint64_t at = blocks * static_cast<std::uint64_t>(r) / static_cast<std::uint64_t>(ranks);
    return static_cast<std::uint32_t>(std::min<std::uint64_t>(at * kShareBlock, splats));
  };
  return {edge(rank), edge(rank + 1) - edge(rank)};
}

// Returns the largest number of splats that any rank owns.
inline std::uint32_t largest_share(std::uint32_t splats, int ranks) {
  std::uint32_t most = 0;
  for (int r = 0; r < ranks; ++r) most = std::max(most, share_of(splats, ranks, r).count);
  return most;
}

}  // namespace ubs
