// SPDX-License-Identifier: Apache-2.0
// Which splats of a model a rank has: contiguous, a function of their number and of the ranks alone. In whole
// blocks, so that the same splats meet in the vectors of a kernel for every number of ranks: kernels choose a
// path by all lanes of a vector, and paths may differ in the last bit.
#pragma once

#include <algorithm>
#include <cstdint>

namespace ubs {

inline constexpr std::uint32_t kShareBlock = 64;  // at least the lanes of a vector

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

// The most that a rank has of so many.
inline std::uint32_t largest_share(std::uint32_t splats, int ranks) {
  std::uint32_t most = 0;
  for (int r = 0; r < ranks; ++r) most = std::max(most, share_of(splats, ranks, r).count);
  return most;
}

}  // namespace ubs
