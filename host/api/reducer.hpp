// SPDX-License-Identifier: Apache-2.0
// Reducer decides for each splat of a model whether it is kept, removed, or replaced by a splat of fewer
// dimensions. A single bound limits the change of a pixel's blended weight in any of the measured views.
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
  bool splats = true, dimensions = true;  // what may be removed
};

struct Reduced {
  MixedModel model;                      // groups of descending N; none is empty, except in an empty model
  std::vector<std::uint32_t> new_index;  // new index of each original splat, or kGone
  // 1 if the splat was replaced by one of fewer dimensions and may look different.
  std::vector<std::uint8_t> turned;
  // Numbers of splats that were removed (`unseen`) and replaced (`inert`) without any effect on the views:
  // unseen splats contribute to no pixel, and the removed dimensions of inert splats have no effect.
  std::size_t unseen = 0, inert = 0;
  std::size_t dropped = 0, turned_count = 0;  // numbers of lossy removals and replacements
};

class Reducer {
 public:
  // `contributions` has the contribution of each splat to the views of `cameras`. Replacements that would
  // change a weight by more than `worst` are not considered.
  Reducer(const MixedModel& model, const std::vector<Camera>& cameras, const Contributions& contributions,
          double eps2d, double worst);

  // Deleted, because the model and the contributions must outlive the reducer.
  Reducer(MixedModel&&, const std::vector<Camera>&, const Contributions&, double, double) = delete;

  // With bound 0, removes only what is lossless in the views. Otherwise it also removes splats whose largest
  // weight is at most `bound`, and dimensions whose replacement changes no weight by more than `bound` (as
  // estimated from the conditional slices).
  Reduced reduce(double bound, const ReduceChoice& choice = {}) const;

  const std::vector<std::vector<Replacement>>& replacements() const { return replacements_; }  // by splat
  const Contributions& contributions() const { return contributions_; }

 private:
  const MixedModel& model_;
  const Contributions& contributions_;
  std::vector<std::vector<Replacement>> replacements_;
};

}  // namespace ubs::reduce
