// SPDX-License-Identifier: Apache-2.0
// The parts of the benchmark that need no device: statistics, cases, costs, comparison, fits, plots.
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "host/bench/bench_scene.hpp"
#include "host/bench/report.hpp"
#include "host/bench/scaling.hpp"
#include "host/bench/startup_bench.hpp"
#include "host/data/npy.hpp"
#include "host/report/svg_chart.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::bench;
using Catch::Contains;
using ubs::test::message_of;
using ubs::test::TempFolder;

TEST_CASE("bench: median, quartiles and the uncertainty of the median") {
  const Summary s = summarise(std::vector<double>{5, 1, 4, 2, 3});
  CHECK(s.samples == 5);
  CHECK(s.minimum == 1);
  CHECK(s.lower_quartile == 2);
  CHECK(s.median == 3);
  CHECK(s.upper_quartile == 4);
  CHECK(summarise({}).samples == 0);
  CHECK(summarise(std::vector<double>{7}).uncertainty() == 1);

  // Standard deviation of medians of 101 normal values against the estimate from one such set.
  std::mt19937 generator(1);
  std::normal_distribution<double> noise(10, 1);
  std::vector<double> medians, estimates;
  for (int i = 0; i < 400; ++i) {
    std::vector<double> values(101);
    for (double& v : values) v = noise(generator);
    const Summary summary = summarise(values);
    medians.push_back(summary.median);
    estimates.push_back(summary.uncertainty() * summary.median);
  }
  double mean = 0, squared = 0;
  for (const double m : medians) mean += m / 400;
  for (const double m : medians) squared += (m - mean) * (m - mean) / 400;
  CHECK(summarise(estimates).median == Approx(std::sqrt(squared)).epsilon(0.03));  // observed: 0.2 %
}

TEST_CASE("bench: sampling stops when the median is known, or the time is over") {
  Sampler quiet({.uncertainty = 0.01, .min_seconds = 0, .max_seconds = 100, .min_samples = 5});
  for (int i = 0; i < 4; ++i) quiet.add(1);
  CHECK_FALSE(quiet.enough());
  quiet.add(1);
  CHECK(quiet.enough());
  Sampler noisy({.uncertainty = 0.01, .min_seconds = 0, .max_seconds = 100, .min_samples = 5});
  for (int i = 0; i < 20; ++i) noisy.add(1 + i % 2);
  CHECK_FALSE(noisy.enough());
  Sampler late({.uncertainty = 0, .min_seconds = 0, .max_seconds = 0, .min_samples = 5});
  CHECK_FALSE(late.enough());
  late.add(1);
  CHECK(late.enough());
}

TEST_CASE("bench: the garden from a folder of arrays") {
  const TempFolder folder;
  const auto put_array = [&](const char* name, std::vector<std::size_t> shape, std::vector<float> values) {
    write_npy(folder / fmt::format("{}.npy", name), shape, values);
  };
  put_array("means3d", {2, 3}, {0, 1, 2, 3, 4, 5});
  put_array("colors", {2, 3}, {255, 0, 0, 0, 128, 300});
  put_array("viewmats", {1, 4, 4}, {1, 0, 0, 7, 0, 1, 0, 8, 0, 0, 1, 9, 0, 0, 0, 1});
  put_array("Ks", {1, 3, 3}, {50, 0, 10, 0, 60, 5, 0, 0, 1});
  put_array("width", {}, {20});
  put_array("height", {}, {12});
  const SceneSize size = garden_size(folder.path());
  CHECK((size.splats == 2 && size.width == 20 && size.height == 12));
  const BenchScene scene = garden_scene(folder.path(), 6);
  CHECK(scene.model.count == 2);
  CHECK(scene.model.row(scene.model.layout().xyz + 1)[1] == 4);
  REQUIRE(scene.views.views.size() == 1);
  const Camera& camera = scene.views.views[0].camera;
  CHECK((camera.fx == 50 && camera.fy == 60 && camera.cx == 10 && camera.cy == 5));
  CHECK(camera.translation == std::array<double, 3>{7, 8, 9});
  put_array("colors", {2, 3}, {255, 0, NAN, 0, 128, 300});
  CHECK(message_of([&] { garden_scene(folder.path(), 6); }).find("not finite") != std::string::npos);
  put_array("colors", {1, 3}, {1, 2, 3});
  CHECK(message_of([&] { garden_scene(folder.path(), 6); }).find("belong together") != std::string::npos);
  put_array("colors", {2, 3}, {255, 0, 0, 0, 128, 300});
  put_array("Ks", {1, 3, 3}, {0, 0, 10, 0, 60, 5, 0, 0, 1});
  CHECK(message_of([&] { garden_scene(folder.path(), 6); }).find("camera 0: the focal") != std::string::npos);
  std::filesystem::remove(folder / "Ks.npy");
  CHECK(message_of([&] { garden_scene(folder.path(), 6); }).find("Ks.npy") != std::string::npos);
}

TEST_CASE("bench: case names, sizes, selection") {
  const std::vector<BenchCase> cases = all_cases({});
  const auto has = [&](const char* name) {
    return std::ranges::find(cases, std::string(name), &BenchCase::name) != cases.end();
  };
  CHECK(has("adam.synthetic.30K.200x200"));
  CHECK(has("iteration.random.100K.400x400"));
  CHECK(has("render.synthetic.300K.800x800"));
  CHECK(has("forward_backward.synthetic.300K.800x800"));
  CHECK(has("startup_cold.glossy.30K.200x200"));
  CHECK_FALSE(std::ranges::any_of(cases, [](const BenchCase& c) { return c.scene == "garden"; }));
  const std::vector<BenchCase> garden = all_cases({.garden = {138'766, 648, 420}});
  CHECK(std::ranges::find(garden, std::string("lists.garden.138766.648x420"), &BenchCase::name) !=
        garden.end());
  for (std::size_t i = 0; i < cases.size(); ++i)
    for (std::size_t k = 0; k < i; ++k) CHECK(cases[i].name() != cases[k].name());

  CHECK(select_cases(cases, "^adam").size() == 8);
  CHECK(select_cases(cases, "").size() == cases.size());
  CHECK(select_cases(cases, "nothing").empty());
  CHECK(message_of([&] { select_cases(cases, "("); }, ErrorKind::usage).find("regular expression") !=
        std::string::npos);
  const SceneSize size = parse_scene_size("640x480/1M");
  CHECK((size.width == 640 && size.height == 480 && size.splats == 1'000'000));
  for (const char* wrong : {"", "640x480", "640x480/", "640/480x3", "x4/3", "4x4/0", "4x4/3Kx", "99999x4/3"})
    CHECK_FALSE(message_of([&] { parse_scene_size(wrong); }, ErrorKind::usage).empty());
}

TEST_CASE("bench: costs grow with what they depend on, and an iteration is the sum of its stages") {
  WorkCounts c{ParameterLayout(6), 1000, 900, 5000, 4000, 20'000, 150'000, 0, 0, 10'000, 10'240};
  CHECK(stage_cost("adam", c).bytes == 1000.0 * 35 * 28);
  CHECK(stage_cost("raster_forward", c).flops == 55.0 * 150'000);
  Cost sum;
  for (const std::string& stage : step_stages()) {
    const Cost cost = stage_cost(stage, c);
    CHECK(cost.bytes > 0);
    if (stage == "relocate" || stage == "grow" || stage == "noise") continue;
    if (stage == "project_backward" || stage == "regularise" || stage == "adam")
      continue;  // they are `learn`
    sum.bytes += cost.bytes;
    sum.flops += cost.flops;
  }
  CHECK(stage_cost("forward_backward", c).flops ==
        Approx(sum.flops - stage_cost("image_loss", c).flops - stage_cost("learn", c).flops +
               stage_cost("project_backward", c).flops));
  CHECK(stage_cost("learn", c).flops ==
        Approx(stage_cost("project_backward", c).flops + stage_cost("regularise", c).flops +
               stage_cost("adam", c).flops));
  CHECK(stage_cost("learn", c).bytes < stage_cost("project_backward", c).bytes + stage_cost("adam", c).bytes);
  CHECK(stage_cost("iteration", c).bytes == Approx(sum.bytes));
  CHECK(stage_cost("iteration", c).flops == Approx(sum.flops));
  CHECK(stage_cost("startup_cold", c).bytes == 0);
  WorkCounts gaussian = c;
  gaussian.layout = ParameterLayout(6, {.kernel = SpatialKernel::gaussian, .colour = ColourMode::sh3});
  CHECK(stage_cost("adam", gaussian).bytes == 1000.0 * (35 - 1 - 3 + 48) * 28);
  CHECK(stage_cost("raster_forward", gaussian).flops < stage_cost("raster_forward", c).flops);
  CHECK(stage_cost("raster_forward", gaussian).issue_lanes == 0);
  CHECK(projection_flops(gaussian.layout) == projection_flops(c.layout) + 8 * 16);
  CHECK(projection_flops(ParameterLayout(3)) < projection_flops(ParameterLayout(4)));
  CHECK(projection_flops(ParameterLayout(6)) < projection_flops(ParameterLayout(7)));
}

TEST_CASE("bench: lists are counted by the passes of their kernels") {
  WorkCounts c{ParameterLayout(6), 1000, 900, 5000};
  c.tiles = 2500;
  c.lists = RasterKind::cpu;
  CHECK(stage_cost("lists", c).bytes == 20.0 * 1000 + (8 + 20 + 28) * 900.0 + 8 * 5000);
  c.splats = c.visible = 2'000'000;  // digits of 8 bits instead of 12
  CHECK(stage_cost("lists", c).bytes == 2e6 * (20 + 8 + 2 * 24 + 20 + 28) + 8 * 5000);
  c.splats = 1000;
  c.visible = 900;
  c.lists = RasterKind::gpu;
  CHECK(stage_cost("lists", c).bytes == 8.0 * 1000 + (4 + 12 + 68 + 40) * 900.0 + (24 + 2 * 16) * 5000.0);
  c.tiles = 256;  // one pass by tile
  CHECK(stage_cost("lists", c).bytes == 8.0 * 1000 + (4 + 12 + 68 + 40) * 900.0 + (24 + 16) * 5000.0);
}

TEST_CASE("bench: the hardest ceiling bounds") {
  const CeilingRates ceilings{.fma = 100,
                              .update = 10,
                              .private_cache = 100,
                              .shared_cache = 50,
                              .private_cache_bytes = 1'000'000,
                              .shared_cache_bytes = 100'000'000};
  CHECK(bound_of({2e9, 1e9, 0}, ceilings, true).by == "memory");
  CHECK(bound_of({2e9, 1e9, 0}, ceilings, true).ms == Approx(200));
  CHECK(bound_of({1e7, 0, 0}, ceilings, true).by == "cache");
  CHECK(bound_of({1e5, 0, 0}, ceilings, true).by == "l2");
  CHECK(bound_of({1e5, 1e9, 0}, ceilings, true).by == "fma");
  CHECK(bound_of({1e5, 1e9, 1e12}, ceilings, true).by == "issue");
  CHECK(bound_of({1e5, 1e9, 1e12}, ceilings, false).by == "fma");
  CHECK(bound_of({}, ceilings, true).by.empty());
}

namespace {

DeviceReport report_with(double median, double minimum, double quartiles, double cpu = 0, double fma = 500) {
  CaseResult result;
  result.name = std::string("adam.synthetic.30K.200x200");  // g++ 12 warns of the assignment of a literal
  result.wall_ms = {100, median, minimum, median - quartiles / 2, median + quartiles / 2};
  result.cpu_ms = cpu;
  DeviceReport report;
  report.info.name = std::string("a device");
  report.info.driver = std::string("1");
  report.raster = std::string("cpu");
  report.ceilings.fma = fma;
  report.results = {result};
  return report;
}

std::vector<Comparison> compared(const DeviceReport& now, const DeviceReport& old) {
  const nlohmann::ordered_json file{{"devices", {to_json(old)}}};
  return compare(std::vector{now}, read_baseline(nlohmann::ordered_json::parse(file.dump()), "old.json"));
}

}  // namespace

TEST_CASE("bench: a slower baseline is told from noise") {
  const DeviceReport old = report_with(10, 9.5, 0.2);
  REQUIRE(compared(report_with(12, 11.5, 0.2), old).size() == 1);
  CHECK(compared(report_with(12, 11.5, 0.2), old)[0].regression);
  CHECK(compared(report_with(12, 11.5, 0.2), old)[0].ratio == Approx(1.2));
  CHECK_FALSE(compared(report_with(10.4, 10.2, 0.2), old)[0].regression);  // below 5 %
  CHECK_FALSE(compared(report_with(12, 9.6, 0.2), old)[0].regression);     // the minimum did not move
  CHECK_FALSE(compared(report_with(12, 11, 12), old)[0].regression);       // not known well enough
  CHECK_FALSE(compared(report_with(8, 7.5, 0.2), old)[0].regression);
  CHECK(comparison_text(compared(report_with(12, 11.5, 0.2), old)).find("SLOWER") != std::string::npos);
  CHECK(comparison_text(compared(report_with(8, 7.5, 0.2), old)).find("faster") != std::string::npos);

  // Half the ceiling: someone else used the machine, and processor time decides.
  const DeviceReport measured = report_with(10, 9.5, 0.2, 9);
  CHECK_FALSE(compared(report_with(22, 19, 0.2, 9.5, 250), measured)[0].regression);
  CHECK(compared(report_with(22, 19, 0.2, 11, 250), measured)[0].regression);
  CHECK(compared(report_with(22, 19, 0.2, 9.5, 490), measured)[0].regression);

  // Cores that have moved apart make another machine of it; which way round does not matter.
  const auto at_distance = [](double median, double ns) {
    DeviceReport report = report_with(median, 0.95 * median, 0.2);
    report.results[0].core_trip_ns = ns;
    return report;
  };
  CHECK_FALSE(compared(at_distance(12, 350), at_distance(10, 55))[0].regression);
  CHECK(compared(at_distance(12, 350), at_distance(10, 340))[0].regression);
  CHECK(compared(at_distance(12, 55), at_distance(10, 0))[0].regression);  // not known of old files
  CHECK(comparison_text(compared(at_distance(8, 55), at_distance(10, 350))).find("not judged") !=
        std::string::npos);

  DeviceReport other = old;
  other.info.name = "another device";
  CHECK(compared(other, old).empty());
  other = old;
  other.results[0].dim = 7;
  CHECK(compared(other, old).empty());
  other = old;
  other.results[0].form = "kernel gaussian";
  CHECK(compared(other, old).empty());
  other = report_with(12, 11.5, 0.2);
  other.info.driver = std::string("2");
  CHECK_FALSE(compared(other, old)[0].same_driver);

  CHECK(message_of([] {
          read_baseline(nlohmann::ordered_json::parse("{\"a\": 1}"), "x.json");
        }).find("x.json") != std::string::npos);
  CHECK_FALSE(message_of([] {
                read_baseline(nlohmann::ordered_json::parse("x", nullptr, false), "x.json");
              }).empty());
}

TEST_CASE("bench: two devices stand side by side") {
  DeviceReport first = report_with(10, 9, 1), second = report_with(5, 4, 1);
  second.info.name = "another device";
  const std::string text = device_comparison(std::vector{first, second});
  CHECK(text.find("another device") != std::string::npos);
  CHECK(text.find("x0.50") != std::string::npos);
  CHECK(device_comparison(std::vector{first}).empty());
  CHECK(table_row(first.results[0]).find("10.00") != std::string::npos);
}

TEST_CASE("report: a power law is found again") {
  const std::vector<double> x{1, 10, 100, 1000};
  std::vector<double> y;
  for (const double v : x) y.push_back(3 * std::pow(v, 0.8));
  const PowerLaw law = fit_power_law(x, y);
  CHECK(law.exponent == Approx(0.8));
  CHECK(law.factor == Approx(3));
  CHECK(law(50) == Approx(3 * std::pow(50, 0.8)));
  const std::vector<double> same{2, 2}, two{1, 2}, zero{0, 2};
  CHECK_THROWS_AS(fit_power_law(same, two), Error);
  CHECK_THROWS_AS(fit_power_law(two, zero), Error);
}

TEST_CASE("scaling: fits and CSV of made-up points") {
  std::vector<ScalingPoint> points = scaling_points({});
  CHECK(std::ranges::count(points, std::string("splats"), &ScalingPoint::series) == 8);
  CHECK(std::ranges::count(points, std::string("dim"), &ScalingPoint::series) == 4);
  for (const ScalingPoint& p : scaling_points({.max_splats = 10'000})) CHECK(p.splats <= 10'000);
  for (ScalingPoint& p : points) {
    p.iteration_ms = 0.5 * p.x;
    p.peak_bytes = 1000;
    p.intersections = 7;
  }
  for (const ScalingFit& f : fit_scaling(points)) {
    if (f.series == "work") continue;
    CHECK(f.time.exponent == Approx(1));
    CHECK(f.time_upper.exponent == Approx(1));
    CHECK(f.memory.exponent == Approx(0).margin(1e-9));
  }
  CHECK(fit_scaling(points).size() == 6);
  // The same point of two series was taken for two.
  const std::vector<ScalingPoint> twice{
      {.series = "splats", .x = 1000, .splats = 1000, .width = 64, .height = 64, .iteration_ms = 1},
      {.series = "pixels", .x = 4096, .splats = 1000, .width = 64, .height = 64, .iteration_ms = 1}};
  CHECK(fit_scaling(twice).empty());
  const std::string csv = scaling_csv(points);
  CHECK(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')) == points.size() + 1);
  // Eight charts, with fitted lines through the points.
  const std::string sheet = scaling_plot(points, fit_scaling(points), "a device");
  CHECK_THAT(sheet, Contains("a device") && Contains("upper half x^1.00") && Contains("line c1 dashed"));
}

// Kernels of ours were there from before, and the warm case compiled all anew.
TEST_CASE("bench: a cold start has no kernels, a warm one those of the cold one") {
  const TempFolder folder;
  test::put(folder / "ubs", fmt::format("#!/bin/sh\n"
                                        "echo $(ls $UBS_KERNEL_CACHE) >> '{}'\n"
                                        "touch $UBS_KERNEL_CACHE/kernel\n",
                                        (folder / "starts").string()));
  std::filesystem::permissions(folder / "ubs", std::filesystem::perms::owner_all);
  StartupBench startup({.executable = folder / "ubs", .width = 16, .height = 16, .repetitions = 1});
  CHECK(startup.measure(true).samples == 1);
  CHECK(startup.measure(false).samples == 1);
  CHECK(test::get(folder / "starts") == "\nkernel\n");
}

TEST_CASE("plot: ticks are round and lie in the range") {
  CHECK(axis_ticks(0, 10, false) == std::vector<double>{0, 2, 4, 6, 8, 10});
  CHECK(axis_ticks(0.9, 1200, true) == std::vector<double>{1, 10, 100, 1000});
  const std::vector<double> fine = axis_ticks(1.5, 30, true);
  REQUIRE(fine.size() == 4);
  CHECK(fine[0] == Approx(2));
  CHECK(fine[3] == Approx(20));
  const std::vector<double> narrow = axis_ticks(13, 19, true);
  CHECK(narrow.size() >= 4);
  CHECK(tick_text(1000) == "1K");
  CHECK(tick_text(3e6) == "3M");
  CHECK(tick_text(0.05) == "0.05");
}
