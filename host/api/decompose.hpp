// SPDX-License-Identifier: Apache-2.0
// Decomposition of a model by its betas (the papers' interpretability figures): the splats whose raw beta
// lies in an interval of quantiles. Low betas are surfaces (spatial), diffuse colour (angular) and what
// stands still (temporal), high ones texture, highlights and motion. Host code; any form of the method
// that learns the beta in question.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

enum class BetaKind { spatial, angular, temporal };
inline constexpr std::array<BetaKind, 3> kBetaKinds{BetaKind::spatial, BetaKind::angular, BetaKind::temporal};

const char* to_string(BetaKind kind);

// Whether a model of this N and form has the beta: spatial unless the kernel is Gaussian; angular from N = 6
// on; temporal where has_time(N); the latter two unless the form has no query betas. Of several groups one is
// enough.
bool has_beta(const MixedModel& model, BetaKind kind);

// What splats are ordered by, one a splat in the order of the model: the raw spatial beta; the mean of the
// three raw direction betas; the raw beta of time. Splats of groups without that dimension do not depend on
// it: they get minus infinity, the limit of a falling beta. Throws Error(usage) where has_beta() is false.
std::vector<float> beta_values(const MixedModel& model, BetaKind kind);

// Place of every splat among all in the order of beta_values(), equal values in the order of the model: the
// splat of rank k of n (from 0) has (k + 0.5) / n, inside of (0, 1). Throws as beta_values().
std::vector<double> beta_quantiles(const MixedModel& model, BetaKind kind);

// Splats with low <= quantile < high: [0, 1) is all, ranges that share an end have no splat in common, and
// ranges that cover [0, 1) lose none.
struct BetaRange {
  double low = 0, high = 1;
};

// One flag a splat, from beta_quantiles(). Throws Error(usage) unless 0 <= low <= high <= 1.
std::vector<bool> select_by_quantile(const std::vector<double>& quantiles, const BetaRange& range);

// The splats whose flag is set, in their order; flags of several decompositions may be combined before.
// Groups that lose all splats go, but for the first one of a model that loses everything. Throws
// Error(internal) when the number of flags is not that of the splats.
MixedModel keep_splats(const MixedModel& model, const std::vector<bool>& keep);

}  // namespace ubs
