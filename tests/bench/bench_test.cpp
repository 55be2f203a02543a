// SPDX-License-Identifier: Apache-2.0
// Tests of those parts of the benchmark that need no device: statistics, scenes, cases, and the comparison of
// results.
#include <catch2/catch.hpp>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "host/dataset/npy.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/lab/bench/report.hpp"
#include "host/lab/oracle/oracle.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::bench;
using ubs::test::message_of;
using ubs::test::TempFolder;

TEST_CASE("bench: the median, the quartiles and the uncertainty of the median are computed") {
  const Summary s = summarise(std::vector<double>{5, 1, 4, 2, 3});
  CHECK(s.samples == 5);
  CHECK(s.minimum == 1);
  CHECK(s.lower_quartile == 2);
  CHECK(s.median == 3);
  CHECK(s.upper_quartile == 4);
  CHECK(summarise({}).samples == 0);
  CHECK(summarise(std::vector<double>{7}).uncertainty() == 1);

  // Draws 400 sets of 101 normally distributed values. The uncertainty that is estimated from one set must
  // agree with the standard deviation of the medians of all sets.
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
  // The observed difference is 0.2 %.
  CHECK(summarise(estimates).median == Approx(std::sqrt(squared)).epsilon(0.03));
}

TEST_CASE("bench: sampling stops when the median is accurate enough or the maximum time is over") {
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

TEST_CASE("bench: the synthetic object has the documented statistics") {
  for (const int dim : {3, 6, 7}) {
    const BenchScene scene = synthetic_object(dim, 30'000, 200, 200, 1);
    const oracle::Render view =
        oracle::render(oracle::to_model(scene.model), scene.views.views[0].camera, {});
    // Numbers of pixels with more than three splats, and of splats on these pixels.
    double object = 0, blended = 0;
    for (const int splats : view.contributors)
      if (splats > 3) ++object, blended += splats;
    INFO("N = " << dim << ": " << blended / object << " splats per pixel on the " << object
                << " pixels of the object");
    CHECK(view.visible > 29'700);
    CHECK(blended / object == Approx(50).epsilon(0.2));
    CHECK(object / (200 * 200) == Approx(0.46).epsilon(0.1));
  }
}

TEST_CASE("bench: the garden scene is read from a folder of arrays") {
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
  CHECK(message_of([&] { garden_scene(folder.path(), 6); }).find("do not match") != std::string::npos);
  put_array("colors", {2, 3}, {255, 0, 0, 0, 128, 300});
  put_array("Ks", {1, 3, 3}, {0, 0, 10, 0, 60, 5, 0, 0, 1});
  CHECK(message_of([&] { garden_scene(folder.path(), 6); }).find("camera 0: the focal") != std::string::npos);
  std::filesystem::remove(folder / "Ks.npy");
  CHECK(message_of([&] { garden_scene(folder.path(), 6); }).find("Ks.npy") != std::string::npos);
}

TEST_CASE("bench: cases have unique names, are selected by regular expressions, and sizes are parsed") {
  const std::vector<BenchCase> cases = all_cases({});
  const auto has = [&](const char* name) {
    return std::ranges::find(cases, std::string(name), &BenchCase::name) != cases.end();
  };
  CHECK(has("adam.synthetic.30K.200x200"));
  CHECK(has("iteration.random.100K.400x400"));
  CHECK(has("render.synthetic.300K.800x800"));
  CHECK(has("forward_backward.synthetic.300K.800x800"));
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

namespace {

DeviceReport report_with(double median, double minimum, double quartiles) {
  CaseResult result;
  // g++ 12 warns if a string literal is assigned directly.
  result.name = std::string("adam.synthetic.30K.200x200");
  result.wall_ms = {100, median, minimum, median - quartiles / 2, median + quartiles / 2};
  DeviceReport report;
  report.info.name = std::string("a device");
  report.info.driver = std::string("1");
  report.raster = std::string("cpu");
  report.results = {result};
  return report;
}

std::vector<Comparison> compared(const DeviceReport& now, const DeviceReport& old) {
  const nlohmann::ordered_json file{{"devices", {to_json(old)}}};
  return compare(std::vector{now}, read_baseline(nlohmann::ordered_json::parse(file.dump()), "old.json"));
}

}  // namespace

TEST_CASE("bench: a significant slowdown is distinguished from noise") {
  const DeviceReport old = report_with(10, 9.5, 0.2);
  REQUIRE(compared(report_with(12, 11.5, 0.2), old).size() == 1);
  CHECK(compared(report_with(12, 11.5, 0.2), old)[0].regression);
  CHECK(compared(report_with(12, 11.5, 0.2), old)[0].ratio == Approx(1.2));
  CHECK_FALSE(compared(report_with(10.4, 10.2, 0.2), old)[0].regression);  // slower by less than 5 %
  CHECK_FALSE(compared(report_with(12, 9.6, 0.2), old)[0].regression);     // the minimum is hardly larger
  CHECK_FALSE(compared(report_with(12, 11, 12), old)[0].regression);       // the times vary too much
  CHECK_FALSE(compared(report_with(8, 7.5, 0.2), old)[0].regression);
  CHECK(comparison_text(compared(report_with(12, 11.5, 0.2), old)).find("SLOWER") != std::string::npos);
  CHECK(comparison_text(compared(report_with(8, 7.5, 0.2), old)).find("faster") != std::string::npos);

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

TEST_CASE("bench: two devices are compared side by side") {
  DeviceReport first = report_with(10, 9, 1), second = report_with(5, 4, 1);
  second.info.name = "another device";
  const std::string text = device_comparison(std::vector{first, second});
  CHECK(text.find("another device") != std::string::npos);
  CHECK(text.find("x0.50") != std::string::npos);
  CHECK(device_comparison(std::vector{first}).empty());
  CHECK(table_row(first.results[0]).find("10.00") != std::string::npos);
}
