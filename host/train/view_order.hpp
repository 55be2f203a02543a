// SPDX-License-Identifier: Apache-2.0
// Which training view comes next: an endless sequence of random permutations (method.md 4.5), each a
// function of (seed, epoch) alone, so that a run can be resumed anywhere without stored state.
#pragma once

#include <cstdint>
#include <vector>

namespace ubs {

class ViewOrder {
 public:
  ViewOrder(std::uint64_t seed, std::uint32_t views) : seed_(seed), permutation_(views) {}
  // The view of draw number `draw` (0, 1, 2, ...); each run of `views` draws visits every view once.
  std::uint32_t operator()(std::uint64_t draw);

 private:
  void shuffle(std::uint64_t epoch);

  std::uint64_t seed_, epoch_ = ~0ull;
  std::vector<std::uint32_t> permutation_;
};

}  // namespace ubs
