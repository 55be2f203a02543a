// SPDX-License-Identifier: Apache-2.0
// The stress run itself: random cases repeat, pass, and what is wrong on purpose is found, shrunk and saved
// so that it can be seen again.
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "host/data/dataset.hpp"
#include "host/data/ply.hpp"
#include "host/stress/campaign.hpp"
#include "host/stress/random_case.hpp"
#include "host/stress/row_scene.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

using namespace ubs::stress;

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST_CASE("a random case is a function of seed and number", "[stress]") {
  const Case a = random_case(4, 77), b = random_case(4, 77), other = random_case(4, 78);
  CHECK(same_bits(a.model.values, b.model.values));
  CHECK(a.camera.translation == b.camera.translation);
  CHECK_FALSE(same_bits(a.model.values, other.model.values));
}

TEST_CASE("random cases reach what they promise", "[stress]") {
  std::size_t drawn = 0, splats = 0, poisoned = 0, wide = 0, far = 0;
  for (std::uint64_t i = 0; i < 400; ++i) {
    const Case c = random_case(1, i);
    const Expectation e = expect(c);
    drawn += e.study.drawn, splats += c.model.count;
    wide += c.camera.width > 4000;
    far += std::abs(c.camera.centre()[0]) > 1e5;
    for (const float v : c.model.values) poisoned += !std::isfinite(v);
  }
  CHECK(drawn > splats / 2);
  CHECK(drawn < splats);
  CHECK(poisoned > 20);
  CHECK(wide > 3);
  CHECK(far > 10);
}

TEST_CASE("a short campaign passes", "[stress]") {
  for (const auto& device : devices_under_test()) {
    DeviceRunner runner(*device, raster_kind("auto", device->info()));
    const CampaignReport report = run_campaign(runner, {.seed = 20, .cases = 300});
    CHECK(report.cases == 300);
    CHECK(report.failed == 0);
    for (const Failure& f : report.failures) WARN(f.c.name << ": " << f.verdict.problem);
    std::size_t float64 = 0;
    for (const RowReport& form : report.forms)
      float64 += form.outcomes[static_cast<std::size_t>(stress::Outcome::float64)];
    CHECK(float64 > 240);
    // Numbers go on behind the last one.
    CHECK(run_campaign(runner, {.first = std::numeric_limits<std::uint64_t>::max(), .cases = 3}).cases == 3);
  }
}

// One parameter's gradient of the last splat is one percent too large, as a wrong backward formula has it.
void disturb_gradient(const Case& c, DeviceResult& result) {
  if (c.model.count == 0 || result.gradient.count == 0) return;
  result.gradient.row(c.model.layout().opacity)[c.model.count - 1] *= 1.01f;
}

TEST_CASE("a wrong gradient is found, shrunk and can be seen again", "[stress]") {
  for (const auto& device : devices_under_test()) {
    DeviceRunner runner(*device, raster_kind("auto", device->info()));
    const Case c = ordinary_case("whole", 6, 12);
    REQUIRE(examine(c, runner).outcome == stress::Outcome::float64);
    runner.disturb = disturb_gradient;
    const Verdict failed = examine(c, runner);
    REQUIRE(failed.outcome == stress::Outcome::failed);
    CHECK(failed.fault == Fault::gradient);
    CHECK(failed.worst_group == "opacity");
    const Shrunk shrunk = shrink(c, failed, [&](const Case& smaller) { return examine(smaller, runner); });
    CHECK(shrunk.smallest.model.count == 1);
    CHECK(shrunk.smallest.camera.width * shrunk.smallest.camera.height <= 4);
    std::size_t zeros = 0;
    for (const float v : shrunk.smallest.model.values) zeros += v == 0;
    CHECK(zeros > 20);

    const test::TempFolder folder;
    save_case(shrunk.smallest, folder.path() / "case");
    const Case again = load_case(folder.path() / "case");
    CHECK(examine(again, runner).fault == Fault::gradient);
    runner.disturb = nullptr;
    CHECK(examine(again, runner).outcome != stress::Outcome::failed);
  }
}

TEST_CASE("a wrong pixel, a NaN, a touched culled splat and a colour out of range are found", "[stress]") {
  const auto device = devices_under_test().front();
  DeviceRunner runner(*device, raster_kind("auto", device->info()));
  Case c = ordinary_case("faults", 3, 4);
  c.model.row(2)[1] = -5;  // behind the camera
  const auto fault_of = [&](auto disturb) {
    runner.disturb = disturb;
    return examine(c, runner).fault;
  };
  CHECK(fault_of([](const Case&, DeviceResult&) {}) == Fault::none);
  CHECK(fault_of([](const Case&, DeviceResult& r) {
          for (float& v : r.image) v *= 1.005f;
        }) == Fault::image);
  CHECK(fault_of([](const Case&, DeviceResult& r) { r.image[5] = NAN; }) == Fault::image_not_finite);
  CHECK(fault_of([](const Case&, DeviceResult& r) { r.image[5] = 7; }) == Fault::outside_colours);
  CHECK(fault_of([](const Case&, DeviceResult& r) { r.gradient.values[3] = INFINITY; }) ==
        Fault::gradient_not_finite);
  CHECK(fault_of([](const Case&, DeviceResult& r) { r.gradient.row(7)[1] = 1e-20f; }) ==
        Fault::culled_gradient);
  CHECK(fault_of([](const Case&, DeviceResult&) { fail(ErrorKind::memory, "no"); }) == Fault::refused);
}

TEST_CASE("a splat with a parameter beyond all reason is not drawn and has no gradient", "[stress]") {
  for (const auto& device : devices_under_test()) {
    DeviceRunner runner(*device, raster_kind("auto", device->info()));
    const Case good = row_case("range", 6, 3);
    REQUIRE(runner.run(good, {}).totals.visible == 3);
    for (const float value : {1.1e12f, -3.4e38f, -INFINITY, NAN})
      for (int row = 0; row < good.model.layout().count; ++row) {
        Case c = good;
        c.model.row(row)[1] = value;
        const DeviceResult result = runner.run(c, pixel_weights(c));
        INFO("row " << row << " = " << value);
        CHECK(result.totals.visible == 2);
        for (int r = 0; r < c.model.layout().count; ++r) {
          CHECK(result.gradient.row(r)[1] == 0);
          CHECK(std::isfinite(result.gradient.row(r)[0]));
        }
      }
  }
}

TEST_CASE("saved cases come back to the last bit", "[stress]") {
  const test::TempFolder folder;
  Case c = random_case(9, 4);
  c.model.values[1] = NAN, c.model.values[2] = -0.0f, c.model.values[3] = 1e-44f;
  save_case(c, folder.path() / "a");
  CHECK_FALSE(std::filesystem::exists(folder.path() / "a" / "model.ply"));
  const Case back = load_case(folder.path() / "a");
  CHECK(same_bits(back.model.values, c.model.values));
  CHECK(back.camera.rotation == c.camera.rotation);
  CHECK(back.camera.translation == c.camera.translation);
  CHECK(back.settings.background == c.settings.background);
  CHECK(pixel_weights(back) == pixel_weights(c));
  test::put(folder.path() / "b" / "case.json", "{}");
  CHECK_THROWS_WITH(load_case(folder.path() / "b"), Catch::Contains("case.json"));
  // Of a program with another switch.
  auto other = nlohmann::json::parse(test::get(folder.path() / "a" / "case.json"));
  other["variant"].push_back(0);
  test::put(folder.path() / "b" / "case.json", other.dump());
  CHECK_THROWS_WITH(load_case(folder.path() / "b"), Catch::Contains("switches of the method"));
}

TEST_CASE("a saved case that was changed by hand is refused where it makes no sense", "[stress]") {
  const test::TempFolder folder;
  save_case(ordinary_case("changed", 6, 2), folder.path());
  const auto whole = nlohmann::json::parse(test::get(folder.path() / "case.json"));
  const auto refused = [&](const char* at, const nlohmann::json& value) {
    auto changed = whole;
    changed[nlohmann::json::json_pointer(at)] = value;
    test::put(folder.path() / "case.json", changed.dump());
    INFO(at << " " << value);
    CHECK_THROWS_WITH(load_case(folder.path()), Catch::Contains("case.json: "));
  };
  refused("/splats", 1000000000000000);
  refused("/splats", -1);
  refused("/variant/0", 9);
  refused("/variant/0", -1);
  refused("/camera/width", -5);
  refused("/camera/width", 0);
  refused("/camera/fx", 0);
  refused("/camera/rotation/0", 2);
}

TEST_CASE("saved cases are data folders and models for the other subcommands", "[stress]") {
  const test::TempFolder folder;
  Case c = ordinary_case("folder", 7, 3);
  c.camera.time = -0.75;
  c.camera.cx = -100;
  save_case(c, folder.path());
  DatasetOptions options;
  options.load_images = false;
  const Dataset data = load_dataset(folder.path(), options);
  REQUIRE(data.find("test"));
  const Camera& camera = data.find("test")->views.front().camera;
  CHECK(camera.time == Approx(-0.75));
  CHECK(camera.cx == Approx(-100));
  CHECK(camera.fx == Approx(c.camera.fx));
  CHECK(camera.width == c.camera.width);
  for (std::size_t i = 0; i < 9; ++i) CHECK(camera.rotation[i] == Approx(c.camera.rotation[i]).margin(1e-12));
  CHECK(same_bits(read_splat_ply(folder.path() / "model.ply").values, c.model.values));
}

}  // namespace
}  // namespace ubs
