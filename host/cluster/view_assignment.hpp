// SPDX-License-Identifier: Apache-2.0
// ViewAssignment assigns the views of a batch to ranks. Faster ranks render more views. The views are
// rendered in rounds, and in each round a rank renders at most one view. The views of a round are consecutive
// in the batch, so that their gradients arrive in the order of the batch.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace ubs {

inline constexpr std::int64_t kNoView = -1;  // entry of a rank that renders no view in a round

class ViewAssignment {
 public:
  // `speeds` contains the number of views per second that each rank renders. If it is empty, all ranks count
  // as equally fast.
  ViewAssignment(std::uint64_t views, int ranks, std::span<const double> speeds = {}) {
    std::vector<std::uint64_t> counts(static_cast<std::size_t>(ranks));
    for (std::uint64_t view = 0; view < views; ++view) {  // assigns it to the rank that would finish it first
      std::size_t best = 0;
      const auto done = [&](std::size_t r) {
        return static_cast<double>(counts[r] + 1) / (speeds.empty() ? 1 : speeds[r]);
      };
      for (std::size_t r = 1; r < counts.size(); ++r)
        if (done(r) < done(best)) best = r;
      ++counts[best];
    }
    *this = ViewAssignment(std::move(counts));
  }
  // `counts` contains the number of views that each rank renders.
  explicit ViewAssignment(std::vector<std::uint64_t> counts) : counts_(std::move(counts)) {
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

  // Returns the rounds. A round contains the index in the batch of the view that each rank renders, or
  // kNoView.
  const std::vector<std::vector<std::int64_t>>& rounds() const { return rounds_; }
  int rank_of(std::uint64_t view) const { return rank_of_[view]; }
  const std::vector<std::uint64_t>& counts() const { return counts_; }

 private:
  std::vector<std::uint64_t> counts_;
  std::vector<std::vector<std::int64_t>> rounds_;
  std::vector<int> rank_of_;
};

}  // namespace ubs
