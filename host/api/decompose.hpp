// SPDX-License-Identifier: Apache-2.0
// Decomposes a model by its betas, as in the interpretability figures of the papers: selects the splats whose
// raw beta is in an interval of quantiles. Low betas belong to surfaces (spatial), diffuse colour (angular)
// and static parts (temporal); high betas belong to texture, highlights and motion. The selection is computed
// on the host. It works for every variant of the method that trains the beta in question.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

enum class BetaKind { spatial, angular, temporal };
inline constexpr std::array<BetaKind, 3> kBetaKinds{BetaKind::spatial, BetaKind::angular, BetaKind::temporal};

const char* to_string(BetaKind kind);

// Returns whether a model of this N and variant has the beta. A model has the spatial beta unless the kernel
// is Gaussian, the angular beta from N = 6 on, and the temporal beta if has_time(N). Variants without query
// betas have neither the angular nor the temporal beta. In a model with several groups, one group with the
// beta is enough.
bool has_beta(const MixedModel& model, BetaKind kind);

// Returns the values that splats are sorted by, one per splat in the order of the model: the raw spatial
// beta, the mean of the three raw direction betas, or the raw beta of time. Splats of groups without that
// dimension do not depend on it: they get minus infinity, the limit for small betas. Throws Error(usage) if
// has_beta() is false.
std::vector<float> beta_values(const MixedModel& model, BetaKind kind);

// Returns the quantile of every splat in the order of beta_values(); equal values keep the order of the
// model. The splat of rank k of n (from 0) gets (k + 0.5) / n, which is inside of (0, 1). Throws the same
// errors as beta_values().
std::vector<double> beta_quantiles(const MixedModel& model, BetaKind kind);

// Selects the splats with low <= quantile < high. [0, 1) selects all. Adjacent ranges have no splat in
// common, and ranges that together cover [0, 1) lose none.
struct BetaRange {
  double low = 0, high = 1;
};

// Returns one flag per splat, computed from beta_quantiles(). Throws Error(usage) unless 0 <= low <= high <=
// 1.
std::vector<bool> select_by_quantile(const std::vector<double>& quantiles, const BetaRange& range);

// Returns the splats whose flag is set, in their order; the caller may combine the flags of several
// decompositions. Groups that lose all splats are removed; if no splat is left, one empty group remains.
// Throws Error(internal) if there is not one flag per splat.
MixedModel keep_splats(const MixedModel& model, const std::vector<bool>& keep);

}  // namespace ubs
