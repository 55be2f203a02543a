// SPDX-License-Identifier: Apache-2.0
// See decompose.hpp.
#include "host/model/decompose.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

#include "host/base/error.hpp"

namespace ubs {
namespace {

struct BetaRows {
  int first = 0, count = 0;  // parameter rows of the beta; the count is 0 if the model does not have it
};

BetaRows beta_rows(const SplatModel& model, BetaKind kind) {
  const ParameterLayout l = model.layout();
  if (kind == BetaKind::spatial) return {l.beta, model.variant.has_spatial_beta() ? 1 : 0};
  if (!model.variant.has_query_beta() || model.variant.learnt_weights()) return {};
  const bool direction = model.dim >= 6;
  if (kind == BetaKind::angular) return {l.query_beta, direction ? 3 : 0};
  return {l.query_beta + (direction ? 3 : 0), has_time(model.dim) ? 1 : 0};
}

void append_values(std::vector<float>& values, const SplatModel& model, BetaKind kind) {
  const BetaRows rows = beta_rows(model, kind);
  const std::size_t first = values.size();
  values.resize(first + model.count, rows.count ? 0.0f : -std::numeric_limits<float>::infinity());
  for (int r = 0; r < rows.count; ++r)
    for (std::size_t i = 0; i < model.count; ++i)
      values[first + i] += model.row(rows.first + r)[i] / static_cast<float>(rows.count);
}

SplatModel keep_of_group(const SplatModel& model, const std::vector<std::size_t>& splats) {
  SplatModel kept(model.dim, splats.size(), model.variant);
  for (int r = 0; r < model.layout().count; ++r) {
    const std::span<const float> from = model.row(r);
    std::transform(splats.begin(), splats.end(), kept.row(r).begin(), [&](std::size_t i) { return from[i]; });
  }
  return kept;
}

}  // namespace

const char* to_string(BetaKind kind) {
  switch (kind) {
    case BetaKind::spatial:
      return "spatial";
    case BetaKind::angular:
      return "angular";
    case BetaKind::temporal:
      return "temporal";
  }
  fail(ErrorKind::internal, "unknown kind of beta");
}

bool has_beta(const MixedModel& model, BetaKind kind) {
  return std::any_of(model.groups.begin(), model.groups.end(),
                     [&](const SplatModel& group) { return beta_rows(group, kind).count > 0; });
}

std::vector<float> beta_values(const MixedModel& model, BetaKind kind) {
  if (!has_beta(model, kind))
    fail(ErrorKind::usage,
         "the model has no {} betas, so it cannot be decomposed by them (it has {}, variant {})",
         to_string(kind), to_string(model), to_string(model.variant()));
  std::vector<float> values;
  values.reserve(model.count());
  for (const SplatModel& group : model.groups) append_values(values, group, kind);
  return values;
}

std::vector<double> beta_quantiles(const MixedModel& model, BetaKind kind) {
  const std::vector<float> values = beta_values(model, kind);
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  std::vector<double> quantiles(values.size());
  for (std::size_t k = 0; k < order.size(); ++k)
    quantiles[order[k]] = (static_cast<double>(k) + 0.5) / static_cast<double>(order.size());
  return quantiles;
}

std::vector<bool> select_by_quantile(const std::vector<double>& quantiles, const BetaRange& range) {
  if (!(0 <= range.low && range.low <= range.high && range.high <= 1))
    fail(ErrorKind::usage,
         "quantiles {} to {}: both must be between 0 and 1, and the first must not be larger than the second",
         range.low, range.high);
  std::vector<bool> keep(quantiles.size());
  std::transform(quantiles.begin(), quantiles.end(), keep.begin(),
                 [&](double q) { return range.low <= q && q < range.high; });
  return keep;
}

MixedModel keep_splats(const MixedModel& model, const std::vector<bool>& keep) {
  if (keep.size() != model.count())
    fail(ErrorKind::internal, "the number of flags is {}, but the model has {} splats", keep.size(),
         model.count());
  std::vector<SplatModel> groups;
  std::size_t first = 0;
  for (const SplatModel& group : model.groups) {
    std::vector<std::size_t> splats;
    for (std::size_t i = 0; i < group.count; ++i)
      if (keep[first + i]) splats.push_back(i);
    if (!splats.empty()) groups.push_back(keep_of_group(group, splats));
    first += group.count;
  }
  if (groups.empty()) groups.emplace_back(model.dim(), 0, model.variant());
  return MixedModel(std::move(groups));
}

}  // namespace ubs
