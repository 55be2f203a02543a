// SPDX-License-Identifier: Apache-2.0
// Reducer decides for each splat of a model whether it is kept, removed, or replaced by a splat of fewer
// dimensions. A bound limits how much the blended weight (transmittance * alpha) of a splat may change in any
// pixel of the measured views.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "host/model/contributions.hpp"
#include "host/model/replacement.hpp"

namespace ubs::reduce {

inline constexpr std::uint32_t kGone = 0xffffffffu;  // new index of a removed splat

struct ReduceChoice {
  bool splats = true, dimensions = true;  // whether splats, and dimensions of splats, may be removed
};

struct Reduced {
  MixedModel model;                      // groups of descending N; none is empty, except in an empty model
  std::vector<std::uint32_t> new_index;  // new index of each original splat, or kGone
  // For each original splat, 1 if it was replaced by a splat of fewer dimensions.
  std::vector<std::uint8_t> turned;
  // Numbers of splats whose removal or replacement has no effect on the views. `unseen` counts removed
  // splats, which contribute to no pixel. `inert` counts replaced splats whose removed dimensions have no
  // effect.
  std::size_t unseen = 0, inert = 0;
  // Numbers of splats whose removal (`dropped`) or replacement (`turned_count`) may change the views.
  std::size_t dropped = 0, turned_count = 0;
};

class Reducer {
 public:
  // `contributions` contains the contribution of each splat to the views of `cameras`, and `eps2d` is the
  // blur of the renderer [px^2]. Replacements that would change a weight by more than `worst` are not
  // considered.
  Reducer(const MixedModel& model, const std::vector<Camera>& cameras, const Contributions& contributions,
          double eps2d, double worst);

  // This constructor is deleted, because a temporary model would not outlive the reducer.
  Reducer(MixedModel&&, const std::vector<Camera>&, const Contributions&, double, double) = delete;

  // Returns the reduced model. If `bound` is 0, only splats and dimensions that have no effect on the views
  // are removed. Otherwise two more things are removed: splats whose largest weight is at most `bound`, and
  // dimensions whose removal changes no weight by more than `bound`. The change of the weights is an estimate
  // (DimensionEffect::change).
  Reduced reduce(double bound, const ReduceChoice& choice = {}) const;

  const std::vector<std::vector<Replacement>>& replacements() const { return replacements_; }  // by splat
  const Contributions& contributions() const { return contributions_; }

 private:
  const MixedModel& model_;
  const Contributions& contributions_;
  std::vector<std::vector<Replacement>> replacements_;
};

}  // namespace ubs::reduce
