// SPDX-License-Identifier: Apache-2.0
// The parts of `ubs accuracy` that need no device: norms, fronts, configurations, CSV, JSON,
// baselines.
#include <catch2/catch.hpp>
#include <limits>

#include "host/accuracy/accuracy_report.hpp"
#include "host/accuracy/baseline.hpp"
#include "host/accuracy/front.hpp"
#include "host/base/error.hpp"
#include "host/base/json.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::accuracy {
namespace {

using Catch::Contains;
using test::get;
using test::put;
using test::TempFolder;

TEST_CASE("errors: relative 2-norm and maximum; what is not finite is infinitely wrong") {
  ErrorSum sum;
  sum.add(3.5, 3);
  sum.add(-4, -4);
  CHECK(sum.errors().relative == Approx(0.1));
  CHECK(sum.errors().absolute == 0.5);
  ErrorSum zero;
  zero.add(0.25, 0);
  CHECK(zero.errors().relative == 0.25);
  ErrorSum broken;
  broken.add(std::nan(""), 1);
  CHECK(broken.errors().relative == std::numeric_limits<double>::infinity());
  CHECK(broken.errors().absolute == std::numeric_limits<double>::infinity());
}

TEST_CASE("errors: the typical one leaves out the hundredth of splats that differs most") {
  const ParameterLayout layout(3);
  const std::size_t count = 200;
  std::vector<double> truth(static_cast<std::size_t>(layout.count) * count, 1.0);
  std::vector<float> values(truth.begin(), truth.end());
  values[7] = values[8] = 3;  // x of two splats of another order
  values[9] = 1.01f;
  const auto groups = group_errors(layout, count, values, truth);
  CHECK(groups[0].quantity == "xyz");
  CHECK(groups[0].errors.relative == Approx(std::sqrt(8.0001 / 600)));
  CHECK(groups[0].errors.typical == Approx(std::sqrt(0.0001 / 600)).epsilon(1e-3));
  CHECK(groups[0].errors.absolute == 2);
  CHECK(most_relative(groups) == groups[0].errors.relative);
  values[7] = std::numeric_limits<float>::quiet_NaN();  // of one splat, but no matter of order
  CHECK(std::isinf(group_errors(layout, count, values, truth)[0].errors.typical));
}

TEST_CASE("front: dominated points are off it, equal ones within the tolerance are on it") {
  const std::vector<Point> points{
      {1.0, 0.001, 1e-6},     // the default
      {0.8, 0.001, 1e-3},     // faster and worse
      {0.9, 0.001, 2e-3},     // slower and worse than the second
      {1.5, 0.001, 0.95e-6},  // slower, better by less than the tolerance
      {0.99, 0.001, 1.05e-6}  // the default but for noise
  };
  CHECK(pareto_front(points) == std::vector<bool>{true, true, false, false, true});
  // 5 % faster is no gain where times are known to 4 %.
  CHECK(pareto_front(std::vector<Point>{{1, 0.04, 1e-6}, {0.95, 0.04, 1e-6}}) ==
        std::vector<bool>{true, true});
  CHECK(pareto_front(std::vector<Point>{{1, 0.001, 1e-6}, {0.95, 0.001, 1e-6}}) ==
        std::vector<bool>{false, true});
}

TEST_CASE("configurations: text, and the standard table") {
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

Result made_up(const std::string& configuration, double image, double gradient, double time) {
  Result r{
      .device = "A \"fast\" CPU, 2 cores", .scene = "s", .configuration = configuration, .truth = "same"};
  r.image = {"end to end", "forward", {{"image", {image, image, image}}}};
  r.gradient = {"end to end",
                "iteration",
                {{"xyz", {gradient, 1, gradient}}, {"rgb", {gradient / 2, 1, gradient / 2}}}};
  r.loss_gradient = {
      "end to end, own signs of L1", "iteration", {{"xyz", {10 * gradient, 1, 10 * gradient}}}};
  for (const std::string& operation : timed_operations())
    r.times.push_back({operation, 10 * time, time, 0.001});
  return r;
}

TEST_CASE("accuracy: CSV, and the comparison with a later run") {
  const TempFolder folder;
  std::vector<Result> results{made_up("default", 1e-6, 2e-6, 1), made_up("cheap", 1e-3, 2e-3, 0.7)};
  mark_fronts(results);
  CHECK((results[0].image_front && results[1].gradient_front));
  CHECK_THAT(accuracy_csv(results), Contains("\n\"A \"\"fast\"\" CPU, 2 cores\",s,cheap,same,"));
  put(folder / "a.json", json_text({{"results", accuracy_json(results)}}));
  const auto baseline = read_accuracy_baseline(folder / "a.json");
  REQUIRE(baseline.size() == 8);
  CHECK(baseline[0].device == results[0].device);
  for (const BaselineComparison& c : compare_with_baseline(results, baseline)) CHECK(!c.regression);
  results[1].gradient.quantities[1].errors.typical *= 2.5;
  results[0].image.quantities[0].errors.typical = 1e-7;  // better
  const auto comparisons = compare_with_baseline(results, baseline);
  CHECK(std::ranges::count_if(comparisons, &BaselineComparison::regression) == 1);
  CHECK_THAT(baseline_text(comparisons), Contains("s, cheap, end to end, rgb") && Contains("WORSE"));
  results[0].image.quantities[0].errors.typical = std::numeric_limits<double>::infinity();
  CHECK(compare_with_baseline(results, baseline)[0].regression);
  put(folder / "bad.json", R"({"results": [{"device": "x"}]})");
  CHECK_THROWS_WITH(read_accuracy_baseline(folder / "bad.json"), Contains("bad.json: is no accuracy.json"));
}

TEST_CASE("accuracy: means over scenes and the page") {
  std::vector<Result> results{made_up("default", 1e-6, 2e-6, 1), made_up("cheap", 1e-3, 2e-3, 0.5)};
  std::vector<Result> other{made_up("default", 4e-6, 8e-6, 1), made_up("cheap", 4e-3, 2e-3, 0.8)};
  for (Result& r : other) {
    r.scene += '2';
    results.push_back(r);
  }
  add_means(results);
  REQUIRE(results.size() == 6);
  CHECK(results[4].scene == "all");
  CHECK(results[4].image_error() == Approx(2e-6));
  CHECK(results[5].time("forward").ratio == Approx(std::sqrt(0.4)));
  CHECK(results[5].gradient_front);
  const std::string page = accuracy_page(results, {{"* date: today"}, "p.png"});
  CHECK_THAT(page,
             Contains("Geometric means") && Contains("| 2 | cheap | same | 2.00e-03") && Contains("p.png"));
}

}  // namespace
}  // namespace ubs::accuracy
