// SPDX-License-Identifier: Apache-2.0
// ViewOrder determines the order in which training views are used. The order consists of random permutations
// of all views, one per epoch (method.md 4.5). A permutation depends only on the seed and the number of the
// epoch, so that a run can be resumed at any iteration without any stored state.
#pragma once

#include <cstdint>
#include <vector>

namespace ubs {

class ViewOrder {
 public:
  ViewOrder(std::uint64_t seed, std::uint32_t views) : seed_(seed), permutation_(views) {}
  // Returns the view of draw number `draw` (0, 1, 2, ...). An epoch consists of `views` draws, in which each
  // view occurs once.
  std::uint32_t operator()(std::uint64_t draw);

 private:
  void shuffle(std::uint64_t epoch);

  std::uint64_t seed_, epoch_ = ~0ull;
  std::vector<std::uint32_t> permutation_;
};

}  // namespace ubs
