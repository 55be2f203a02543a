// SPDX-License-Identifier: Apache-2.0
// Deal assigns the views of a batch to ranks. Faster ranks render more of them. The views that are rendered
// at the same time, at most one per rank, are consecutive in the batch, so that their gradients arrive in the
// order of the batch.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace ubs {

inline constexpr std::int64_t kNoView = -1;

class Deal {
 public:
  // speeds: views per second of each rank; empty: all are equally fast.
  Deal(std::uint64_t views, int ranks, std::span<const double> speeds = {}) {
    std::vector<std::uint64_t> counts(static_cast<std::size_t>(ranks));
    for (std::uint64_t view = 0; view < views; ++view) {  // assign it to the rank that would finish first
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
  // counts: number of views that each rank renders.
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

  // Returns, for each round, the view that each rank renders, as its index in the batch.
  const std::vector<std::vector<std::int64_t>>& rounds() const { return rounds_; }
  int rank_of(std::uint64_t view) const { return rank_of_[view]; }
  const std::vector<std::uint64_t>& counts() const { return counts_; }

 private:
  std::vector<std::uint64_t> counts_;
  std::vector<std::vector<std::int64_t>> rounds_;
  std::vector<int> rank_of_;
};

}  // namespace ubs
