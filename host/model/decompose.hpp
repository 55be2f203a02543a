// SPDX-License-Identifier: Apache-2.0
// These functions decompose a model by its betas, as in the interpretability figures of the papers: they
// select the splats whose raw beta is in an interval of quantiles. Low spatial betas belong to surfaces and
// high ones to texture; low angular betas belong to diffuse colour and high ones to highlights; low temporal
// betas belong to static parts and high ones to motion. The selection is computed on the host. It works for
// every variant of the method that trains the selected kind of beta.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

enum class BetaKind { spatial, angular, temporal };
inline constexpr std::array<BetaKind, 3> kBetaKinds{BetaKind::spatial, BetaKind::angular, BetaKind::temporal};

const char* to_string(BetaKind kind);

// Returns whether a model has betas of this kind. A model has the spatial beta unless its kernel is Gaussian,
// the angular beta if N >= 6, and the temporal beta if has_time(N). Variants without query betas have neither
// the angular nor the temporal beta. For a model with several groups, the function returns true if one of the
// groups has the beta.
bool has_beta(const MixedModel& model, BetaKind kind);

// Returns the values that splats are sorted by, one per splat in the order of the model: the raw spatial
// beta, the mean of the three raw direction betas, or the raw beta of time. Splats of groups without the
// dimension that `kind` refers to get minus infinity, because they do not depend on this dimension, like
// splats whose beta is very small. Throws Error(usage) if has_beta() is false.
std::vector<float> beta_values(const MixedModel& model, BetaKind kind);

// Returns the quantile of every splat in the order of beta_values(); equal values keep the order of the
// model. Of n splats, the one at position k of the sorted order, counted from 0, gets (k + 0.5) / n, so no
// quantile is 0 or 1. Throws the same errors as beta_values().
std::vector<double> beta_quantiles(const MixedModel& model, BetaKind kind);

// A BetaRange selects the splats with low <= quantile < high. The default selects all splats. Because `high`
// itself is excluded, adjacent ranges have no splat in common, and ranges that together cover [0, 1) select
// every splat.
struct BetaRange {
  double low = 0, high = 1;
};

// Returns one flag per splat, which says whether `range` selects it. `quantiles` are those of
// beta_quantiles(). Throws Error(usage) unless 0 <= low <= high <= 1.
std::vector<bool> select_by_quantile(const std::vector<double>& quantiles, const BetaRange& range);

// Returns the splats whose flag is set, in their order; the caller may combine the flags of several
// decompositions. Groups that lose all splats are removed; if no splat is left, one empty group remains.
// Throws Error(internal) if the number of flags is not the number of splats.
MixedModel keep_splats(const MixedModel& model, const std::vector<bool>& keep);

}  // namespace ubs
