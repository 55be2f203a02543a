// SPDX-License-Identifier: Apache-2.0
// ViewOrder determines which training view comes next. The order is an endless sequence of random
// permutations (method.md 4.5). Each permutation depends only on (seed, epoch), so that a run can be resumed
// at any iteration without stored state.
#pragma once

#include <cstdint>
#include <vector>

namespace ubs {

class ViewOrder {
 public:
  ViewOrder(std::uint64_t seed, std::uint32_t views) : seed_(seed), permutation_(views) {}
  // Returns the view of draw number `draw` (0, 1, 2, ...). Every epoch, which is `views` draws, visits each
  // view once.
  std::uint32_t operator()(std::uint64_t draw);

 private:
  void shuffle(std::uint64_t epoch);

  std::uint64_t seed_, epoch_ = ~0ull;
  std::vector<std::uint32_t> permutation_;
};

}  // namespace ubs
