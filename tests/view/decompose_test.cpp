// SPDX-License-Identifier: Apache-2.0
// Tests the selection of splats by quantiles of their spatial, angular or temporal betas: the correct
// parameter rows are used, adjacent ranges contain each splat exactly once, and invalid arguments are
// rejected.
#include "host/model/decompose.hpp"

#include <limits>
#include <numeric>

#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

// Returns a model in which the beta of splat i in the beta row r is r - i.
SplatModel falling(int dim, std::size_t count, const ModelVariant& variant = {}) {
  SplatModel model(dim, count, variant);
  std::iota(model.values.begin(), model.values.end(), 0.0f);
  const ParameterLayout l = model.layout();
  for (int r = l.beta; r < l.mean; ++r)
    for (std::size_t i = 0; i < count; ++i)
      model.row(r)[i] = static_cast<float>(r - l.beta) - static_cast<float>(i);
  return model;
}

std::vector<bool> select_by_beta(const MixedModel& model, BetaKind kind, const BetaRange& range) {
  return select_by_quantile(beta_quantiles(model, kind), range);
}

std::size_t kept(const std::vector<bool>& keep) {
  return static_cast<std::size_t>(std::count(keep.begin(), keep.end(), true));
}

}  // namespace

TEST_CASE("decompose: for every dimension, the correct beta rows are used", "[view]") {
  struct Row {
    int dim;
    bool angular, temporal;
    // Values of the first splat, whose beta in row r is r. The angular value is the mean of its rows.
    float angular_value, temporal_value;
  };
  for (const Row& row : {Row{3, false, false, 0, 0},
                         {4, false, true, 0, 1},
                         {5, false, true, 0, 1},
                         {6, true, false, 2, 0},
                         {7, true, true, 2, 4},
                         {9, true, true, 2, 4}}) {
    CAPTURE(row.dim);
    const MixedModel model = falling(row.dim, 4);
    CHECK(beta_values(model, BetaKind::spatial) == std::vector<float>{0, -1, -2, -3});
    CHECK(has_beta(model, BetaKind::angular) == row.angular);
    CHECK(has_beta(model, BetaKind::temporal) == row.temporal);
    if (row.angular) CHECK(beta_values(model, BetaKind::angular)[1] == Approx(row.angular_value - 1));
    if (row.temporal) CHECK(beta_values(model, BetaKind::temporal)[1] == row.temporal_value - 1);
  }
}

TEST_CASE("decompose: missing betas and invalid ranges are rejected", "[view]") {
  const auto values = [](const SplatModel& model, BetaKind kind) { return beta_values(model, kind); };
  const auto refusal = [&](const SplatModel& model, BetaKind kind) {
    return message_of([&] { values(model, kind); }, ErrorKind::usage);
  };
  CHECK_THAT(refusal(falling(3, 5), BetaKind::angular),
             Contains("no angular betas") && Contains("N = 3, 5 splats"));
  CHECK_THAT(refusal(falling(6, 5), BetaKind::temporal), Contains("no temporal betas"));
  CHECK_THAT(refusal(falling(6, 5, {.kernel = SpatialKernel::gaussian}), BetaKind::spatial),
             Contains("no spatial betas") && Contains("kernel gaussian"));
  const ModelVariant none{.beta_cond = BetaCond::off, .beta_opacity = BetaOpacity::none};
  CHECK_THAT(refusal(falling(7, 5, none), BetaKind::angular), Contains("no angular betas"));
  CHECK_FALSE(has_beta(falling(7, 5, none), BetaKind::temporal));
  CHECK(has_beta(falling(7, 5, none), BetaKind::spatial));
  CHECK(has_beta(falling(7, 5, {.kernel = SpatialKernel::gaussian}), BetaKind::temporal));

  for (const BetaRange& range :
       {BetaRange{-0.1, 1}, {0, 1.1}, {0.6, 0.5}, {0, std::numeric_limits<double>::quiet_NaN()}})
    CHECK_THAT(message_of([&] { select_by_beta(falling(3, 5), BetaKind::spatial, range); }, ErrorKind::usage),
               Contains("between 0 and 1"));
}

TEST_CASE("decompose: each splat is in exactly one of two adjacent ranges", "[view]") {
  const MixedModel model = falling(7, 11);
  for (const BetaKind kind : kBetaKinds) {
    const std::vector<bool> low = select_by_beta(model, kind, {0, 0.5}),
                            high = select_by_beta(model, kind, {0.5, 1});
    CHECK(kept(low) == 5);  // the splat in the middle of 11 belongs to the upper half
    for (std::size_t i = 0; i < 11; ++i) {
      CHECK(low[i] == (i > 5));  // betas decrease with the index
      CHECK(high[i] != low[i]);
    }
    CHECK(kept(select_by_beta(model, kind, {})) == 11);
    CHECK(kept(select_by_beta(model, kind, {0.3, 0.3})) == 0);
  }
  // Splats with equal betas are ordered by their index.
  SplatModel equal = falling(6, 4);
  for (float& v : equal.row(equal.layout().beta)) v = 1;
  CHECK(beta_quantiles(equal, BetaKind::spatial) == std::vector<double>{0.125, 0.375, 0.625, 0.875});
  CHECK(beta_quantiles(SplatModel(6, 0), BetaKind::spatial).empty());
}

TEST_CASE("decompose: in models with different dimensions, splats without a beta have the lowest quantiles",
          "[view]") {
  const MixedModel model(std::vector<SplatModel>{falling(7, 3), falling(6, 2), falling(3, 4)});
  const float none = -std::numeric_limits<float>::infinity();
  CHECK(beta_values(model, BetaKind::temporal) ==
        std::vector<float>{4, 3, 2, none, none, none, none, none, none});

  // Splats without time belong to the lowest range, which contains the static splats.
  const MixedModel still = keep_splats(model, select_by_beta(model, BetaKind::temporal, {0, 6.0 / 9}));
  CHECK(to_string(still) == "6 splats: 2 with N = 6, 4 with N = 3");
  CHECK(still.groups[0].values == model.groups[1].values);
  CHECK(still.groups[1].values == model.groups[2].values);

  const MixedModel moving = keep_splats(model, select_by_beta(model, BetaKind::temporal, {7.0 / 9, 1}));
  CHECK(to_string(moving) == "N = 7, 2 splats");
  for (int r = 0; r < moving.groups[0].layout().count; ++r)
    for (std::size_t i = 0; i < 2; ++i) CHECK(moving.groups[0].row(r)[i] == model.groups[0].row(r)[i]);

  const MixedModel nothing = keep_splats(model, std::vector<bool>(9));
  CHECK(to_string(nothing) == "N = 7, 0 splats");
  CHECK_THAT(message_of([&] { keep_splats(model, std::vector<bool>(8)); }, ErrorKind::internal),
             Contains("the number of flags is 8"));
}
