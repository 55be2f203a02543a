// SPDX-License-Identifier: Apache-2.0
// Which rank draws which view of a batch. Ranks that are faster draw more of them. The views that are drawn
// at the same time, one a rank at most, follow each other in the batch: so their gradients come in its order.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace ubs {

inline constexpr std::int64_t kNoView = -1;

class Deal {
 public:
  // `speeds`: views a second by rank; none: all are equal.
  Deal(std::uint64_t views, int ranks, std::span<const double> speeds = {}) {
    std::vector<std::uint64_t> counts(static_cast<std::size_t>(ranks));
    for (std::uint64_t view = 0; view < views; ++view) {  // to the rank that would be done first
      std::size_t best = 0;
      const auto done = [&](std::size_t r) {
        return static_cast<double>(counts[r] + 1) / (speeds.empty() ? 1 : speeds[r]);
      };
      for (std::size_t r = 1; r < counts.size(); ++r)
        if (done(r) < done(best)) best = r;
      ++counts[best];
    }
    *this = Deal(std::move(counts));
  }
  // How many views each rank draws.
  explicit Deal(std::vector<std::uint64_t> counts) : counts_(std::move(counts)) {
    for (bool more = true; more;) {
      more = false;
      std::vector<std::int64_t> round(counts_.size(), kNoView);
      for (std::size_t r = 0; r < counts_.size(); ++r)
        if (rounds_.size() < counts_[r]) {
          round[r] = static_cast<std::int64_t>(rank_of_.size());
          rank_of_.push_back(static_cast<int>(r));
          more = true;
        }
      if (more) rounds_.push_back(std::move(round));
    }
  }

  // Of each round the view that each rank draws: its place in the batch.
  const std::vector<std::vector<std::int64_t>>& rounds() const { return rounds_; }
  int rank_of(std::uint64_t view) const { return rank_of_[view]; }
  const std::vector<std::uint64_t>& counts() const { return counts_; }

 private:
  std::vector<std::uint64_t> counts_;
  std::vector<std::vector<std::int64_t>> rounds_;
  std::vector<int> rank_of_;
};

}  // namespace ubs
