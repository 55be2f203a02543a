// SPDX-License-Identifier: Apache-2.0
// Tests of the parts of `ubs-lab accuracy` that need no device: norms, configurations and the table.
#include <catch2/catch.hpp>
#include <limits>

#include "host/base/json.hpp"
#include "host/lab/accuracy/table.hpp"

namespace ubs::accuracy {
namespace {

using Catch::Contains;

TEST_CASE("errors: the relative 2-norm and the maximum are computed, and are infinite if a value is NaN") {
  check::ErrorSum sum;
  sum.add(3.5, 3);
  sum.add(-4, -4);
  CHECK(sum.errors().relative == Approx(0.1));
  CHECK(sum.errors().absolute == 0.5);
  check::ErrorSum zero;
  zero.add(0.25, 0);
  CHECK(zero.errors().relative == 0.25);
  check::ErrorSum broken;
  broken.add(std::nan(""), 1);
  CHECK(broken.errors().relative == std::numeric_limits<double>::infinity());
  CHECK(broken.errors().absolute == std::numeric_limits<double>::infinity());
}

TEST_CASE("errors: the typical error excludes the 1 % of splats that differ most") {
  const ParameterLayout layout(3);
  const std::size_t count = 200;
  std::vector<double> truth(static_cast<std::size_t>(layout.count) * count, 1.0);
  std::vector<float> values(truth.begin(), truth.end());
  values[7] = values[8] = 3;  // the x of two splats is wrong, as after a different depth order
  values[9] = 1.01f;
  const auto groups = check::group_errors(layout, count, values, truth);
  CHECK(groups[0].quantity == "xyz");
  CHECK(groups[0].errors.relative == Approx(std::sqrt(8.0001 / 600)));
  CHECK(groups[0].errors.typical == Approx(std::sqrt(0.0001 / 600)).epsilon(1e-3));
  CHECK(groups[0].errors.absolute == 2);
  // A different depth order does not cause NaN, so a NaN must not be excluded.
  values[7] = std::numeric_limits<float>::quiet_NaN();
  CHECK(std::isinf(check::group_errors(layout, count, values, truth)[0].errors.typical));
}

TEST_CASE("configurations: texts are parsed, and the standard configurations are valid") {
  const Configuration c = parse_configuration("mine:math=native,alpha_min=0.1|rot_mode=exp");
  CHECK(c.label == "mine");
  CHECK(c.settings == std::vector<std::string>{"math=native", "alpha_min=0.1"});
  CHECK(truth_name(c) == "exp");
  CHECK(truth_variant({}, c).rot_mode == RotMode::exp);
  CHECK(apply({}, c).math == MathMode::native);
  CHECK(parse_configuration("plain").settings.empty());
  CHECK_THROWS_WITH(parse_configuration("a:maths=native"), Contains("maths"));
  CHECK_THROWS_WITH(parse_configuration(":math=native"), Contains("label:key=value"));
  const auto& standard = standard_configurations();
  CHECK(standard.size() >= 12);
  CHECK(standard.front().settings.empty());
  for (const Configuration& s : standard) CHECK_NOTHROW(validate(apply({}, s)));
}

TEST_CASE("table: the results are written as text, CSV and JSON") {
  const check::Errors image{1e-6, 5e-6, 1e-6}, xyz{2e-3, 1, 2e-6}, rgb{1e-3, 1, 1e-6};
  const std::vector<Result> results{
      {.form = "fast",
       .truth = "exp",
       .dim = 6,
       .scene = "s",
       .device = "A \"fast\" CPU, 2 cores",
       .note = "",
       .stages = {{{"forward", {{"image", image}}}, 0.5}, {{"iteration", {{"rgb", rgb}, {"xyz", xyz}}}, 2}}},
      {.form = "never",
       .truth = "same",
       .dim = 6,
       .scene = "s",
       .device = "D",
       .note = "not here",
       .stages = {}}};
  CHECK_THAT(table_row(results[0]), Contains("fast (against exp)") && Contains("1.0e-06    0.500") &&
                                        Contains("2.0e-06    2.000") && Contains(" - "));
  CHECK_THAT(table_row(results[1]), Contains("never") && Contains("not here"));
  CHECK_THAT(table_csv(results),
             Contains("\nfast,exp,6,s,\"A \"\"fast\"\" CPU, 2 cores\",iteration,xyz,0.002,2e-06,1,2\n"));
  const Json json = table_json(results);
  CHECK(json.at(0).at("stages").at("iteration").at("errors").at("xyz").at("typical") == 2e-6);
  CHECK(json.at(0).at("stages").at("forward").at("median_ms") == 0.5);
  CHECK(json.at(1).at("note") == "not here");
}

}  // namespace
}  // namespace ubs::accuracy
