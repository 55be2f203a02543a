// SPDX-License-Identifier: Apache-2.0
// Decides for each splat of a model whether it stays, goes, or is turned into one of fewer dimensions, by one
// bound on the change of a pixel's blended weight in any of the views it was measured on.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "host/api/contributions.hpp"
#include "host/api/replacement.hpp"

namespace ubs::reduce {

inline constexpr std::uint32_t kGone = 0xffffffffu;

struct ReduceChoice {
  bool splats = true, dimensions = true;  // what may be given up
};

struct Reduced {
  MixedModel model;                      // groups of falling N, none empty unless all are
  std::vector<std::uint32_t> new_index;  // of each splat before; kGone
  std::vector<std::uint8_t> turned;      // 1 where a splat was turned and may be drawn differently
  // Without effect on any of the views: they contribute to no pixel, or their dimensions do nothing.
  std::size_t unseen = 0, inert = 0;
  std::size_t dropped = 0, turned_count = 0;  // lossy
};

class Reducer {
 public:
  // Of each splat the contributions are those to the views of `cameras`. Replacements that would change a
  // weight by more than `worst` are not considered.
  Reducer(const MixedModel& model, const std::vector<Camera>& cameras, const Contributions& contributions,
          double eps2d, double worst);

  Reducer(MixedModel&&, const std::vector<Camera>&, const Contributions&, double,
          double) = delete;  // model and contributions must outlive it

  // bound 0: only what is lossless on the views. Else also splats whose largest weight is at most the bound,
  // and dimensions whose replacement changes no weight by more (as estimated from the conditional slices).
  Reduced reduce(double bound, const ReduceChoice& choice = {}) const;

  const std::vector<std::vector<Replacement>>& replacements() const { return replacements_; }  // by splat
  const Contributions& contributions() const { return contributions_; }

 private:
  const MixedModel& model_;
  const Contributions& contributions_;
  std::vector<std::vector<Replacement>> replacements_;
};

}  // namespace ubs::reduce
