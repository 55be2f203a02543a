// SPDX-License-Identifier: Apache-2.0
#include "host/train/view_order.hpp"

#include <numeric>
#include <utility>

#include "host/base/philox.hpp"

namespace ubs {
namespace {

// Number of the random stream of the view order. It makes the order independent of other random numbers with
// the same seed.
constexpr std::uint32_t kViewOrderStream = 0x76696577;

}  // namespace

std::uint32_t ViewOrder::operator()(std::uint64_t draw) {
  const std::uint64_t views = permutation_.size();
  if (draw / views != epoch_) shuffle(draw / views);
  return permutation_[draw % views];
}

// Shuffles the views, which are initially in ascending order, by the method of Fisher and Yates. A random
// index below i is the high half of the product of a 32-bit random number and i. With up to 4096 views, the
// bias of this method is below 2^-20.
void ViewOrder::shuffle(std::uint64_t epoch) {
  epoch_ = epoch;
  std::iota(permutation_.begin(), permutation_.end(), 0u);
  const CounterRandom random(seed_, kViewOrderStream);
  for (std::size_t i = permutation_.size(); i > 1; --i) {
    const std::uint64_t word = random.bits(epoch, static_cast<std::uint32_t>(i));
    std::swap(permutation_[i - 1], permutation_[static_cast<std::size_t>(word * i >> 32)]);
  }
}

}  // namespace ubs
