// SPDX-License-Identifier: Apache-2.0
// Tests how `ubs report` reads output folders of training runs: folders with missing or truncated files or
// files of another version, the values of splats after their activation functions, images that a run has
// saved, and the camera for models without data.
#include "host/look/report/run_record.hpp"

#include <cmath>

#include "host/look/report/run_drawings.hpp"
#include "host/look/report/splat_values.hpp"
#include "tests/support/images.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

const SplatQuantity* named(const std::vector<SplatQuantity>& all, const std::string& name) {
  for (const SplatQuantity& q : all)
    if (q.name == name) return &q;
  return nullptr;
}

std::vector<std::string> names(const std::vector<SplatQuantity>& all) {
  std::vector<std::string> out;
  for (const SplatQuantity& q : all) out.push_back(q.name);
  return out;
}

}  // namespace

TEST_CASE("run record: logs that are truncated, old or invalid are read as far as possible", "[report]") {
  std::vector<std::string> remarks;
  const Json log = parse_log(
      "iteration,seconds,loss,splats,test_psnr,test_ssim\n10,0.5,0.25,100,,\n20,1.5,,120,21.5,0.9\n30,2.",
      "log.csv",
      remarks);  // the run was killed while it wrote the last row
  CHECK(log == Json{{"iteration", {10.0, 20.0}},
                    {"seconds", {0.5, 1.5}},
                    {"loss", {0.25, nullptr}},
                    {"splats", {100.0, 120.0}},
                    {"test_psnr", {nullptr, 21.5}},
                    {"test_ssim", {nullptr, 0.9}},
                    {"sample_psnr", {nullptr, nullptr}},
                    {"sample_views", {nullptr, nullptr}}});
  REQUIRE(remarks.size() == 1);
  CHECK_THAT(remarks[0], Contains("log.csv: 1 rows"));

  remarks.clear();
  const Json old = parse_log("loss,iteration,extra\r\n0.5,7,what\r\nnan,8,\r\n0.5,,\n", "log.csv", remarks);
  CHECK(old["iteration"] == Json::array({7.0}));
  CHECK(old["loss"] == Json::array({0.5}));
  CHECK(old["seconds"] == Json::array({nullptr}));
  CHECK_THAT(remarks[0], Contains("2 rows"));

  remarks.clear();
  CHECK(parse_log("a,b\n1,2\n", "log.csv", remarks) == Json::object());
  CHECK_THAT(remarks[0], Contains("no column 'iteration'"));
  CHECK(parse_log("", "log.csv", remarks) == Json::object());

  const Json again = parse_log("iteration,loss\n10,1\n20,2\n30,3\n20,4\n", "log.csv", remarks);
  CHECK(again["iteration"] == Json{10.0, 20.0});  // the log went back from iteration 30 to 10
  CHECK(again["loss"] == Json{1.0, 4.0});
}

TEST_CASE("run record: incomplete folders of runs are read, and other folders are rejected", "[report]") {
  const TempFolder folder;
  CHECK_THAT(message_of([&] { read_run(folder / "none"); }), Contains("no such folder"));
  put(folder / "file", "x");
  CHECK_THAT(message_of([&] { read_run(folder / "file"); }), Contains("not a folder"));
  CHECK_THAT(message_of([&] { read_run(folder.path()); }), Contains("not an output folder of 'ubs train'"));

  // The run was killed early, so there are only a log and the settings. One setting is unknown to this
  // version.
  put(folder / "run" / "log.csv", "iteration,loss\n1,0.5\n");
  put(folder / "run" / "config.yaml", "dim: 4\nbackground: [1, 0.50, 0]\nof_tomorrow: yes\n");
  const RunRecord run = read_run((folder / "run").string() + "/");
  CHECK(run.name == "run");
  CHECK(run.metrics.is_null());
  CHECK(run.settings.dim == 4);
  CHECK(run.setting_texts == std::vector<std::pair<std::string, std::string>>{
                                 {"dim", "4"}, {"background", "1,0.5,0"}, {"of_tomorrow", "yes"}});
  CHECK_FALSE(run.number({"splats"}));
  REQUIRE(run.remarks.size() == 2);
  CHECK_THAT(run.remarks[0], Contains("metrics.json is missing"));
  CHECK_THAT(run.remarks[1], Contains("of_tomorrow"));

  put(folder / "old" / "metrics.json", R"({"splats": 12, "test": {"mean": {"psnr": null}}, "settings":
      {"dim": 3, "background": [0.0, 1.0, 0.0], "raster": "cpu"}, "data": "<b>"})");
  const RunRecord old = read_run(folder / "old");
  CHECK(old.number({"splats"}) == 12.0);
  CHECK_FALSE(old.number({"test", "mean", "psnr"}));
  CHECK_FALSE(old.number({"data"}));
  CHECK(old.text({"data"}) == "<b>");
  CHECK(old.text({"splats", "deeper"}).empty());
  CHECK(old.settings.dim == 3);
  CHECK(old.settings.background.colour == std::array<double, 3>{0, 1, 0});
  CHECK(old.settings.raster == "cpu");
  CHECK(old.log.is_null());

  put(folder / "old" / "metrics.json", "{\"splats\": 1");
  CHECK_THAT(message_of([&] { read_run(folder / "old"); }),
             Contains("metrics.json: malformed JSON") && Contains("to do without this file, delete it"));
  put(folder / "old" / "metrics.json", "[]");
  CHECK_THAT(message_of([&] { read_run(folder / "old"); }),
             Contains("metrics.json: must contain a JSON object"));
}

TEST_CASE("splat values are activated according to the variant of the model", "[report]") {
  SplatModel model(7, 2);
  const ParameterLayout l = model.layout();
  model.row(l.opacity)[0] = -800;  // exp(800) is not finite, but the opacity must be 0
  model.row(l.query_beta + 1)[0] = std::log(0.5f);
  model.row(l.query_beta + 3)[1] = std::log(2.0f);
  model.row(l.scale + 6)[1] = 50;
  model.row(l.rgb + 2)[1] = 1.25f;
  model.row(l.mean + 3)[0] = 0.75f;
  const auto all = splat_quantities(model);
  CHECK(names(all) == std::vector<std::string>{"opacity", "spatial scale", "direction scale", "time scale",
                                               "spatial beta", "direction beta", "direction conditioning",
                                               "time beta", "time conditioning", "colour", "time mean"});
  CHECK(named(all, "opacity")->values == std::vector<double>{0, 0.5});
  CHECK(named(all, "spatial scale")->values == std::vector<double>(6, std::log(2.0)));
  CHECK(named(all, "time scale")->values[1] == Approx(50));
  CHECK(named(all, "spatial beta")->values == std::vector<double>{4, 4});
  CHECK(named(all, "direction beta")->values[2] == Approx(2));
  CHECK(named(all, "direction conditioning")->values[2] == Approx(0.5));
  CHECK(named(all, "time beta")->values[1] == Approx(8));
  CHECK(named(all, "time conditioning")->values == std::vector<double>{1, 1});
  CHECK(named(all, "colour")->values[5] == 1.25);
  CHECK(named(all, "time mean")->values == std::vector<double>{0.75, 0});

  CHECK(names(splat_quantities(SplatModel(3, 1))) ==
        std::vector<std::string>{"opacity", "spatial scale", "spatial beta", "colour"});
  CHECK(named(splat_quantities(SplatModel(5, 1)), "further query beta"));
  const ModelVariant gaussians{.beta_cond = BetaCond::off,
                               .beta_opacity = BetaOpacity::gaussian,
                               .kernel = SpatialKernel::gaussian,
                               .colour = ColourMode::sh1};
  const auto plain = splat_quantities(SplatModel(6, 1, gaussians));
  CHECK(names(plain) == std::vector<std::string>{"opacity", "spatial scale", "direction scale", "colour"});
  CHECK(named(plain, "colour")->values == std::vector<double>{0.5, 0.5, 0.5});
  CHECK(splat_quantities(SplatModel(6, 0)).empty());
  const MixedModel mixed(std::vector<SplatModel>{SplatModel(6, 2), SplatModel(3, 5)});
  CHECK(named(splat_quantities(mixed), "opacity")->values.size() == 7);
  CHECK(named(splat_quantities(mixed), "direction scale")->values.size() == 6);
}

TEST_CASE("run images: evenly spaced views are chosen, and saved images are split into truth and render",
          "[report]") {
  CHECK(evenly_spaced(8, 3) == std::vector<std::size_t>{0, 2, 5});
  CHECK(evenly_spaced(2, 5) == std::vector<std::size_t>{0, 1});
  CHECK(evenly_spaced(0, 5).empty());

  const TempFolder folder;
  const Image8 truth = gradient_image(9, 6), render = gradient_image(9, 6, 40);
  Image8 both{18, 6, {}};
  for (int y = 0; y < 6; ++y)
    for (const Image8* image : {&truth, &render})
      both.rgb.insert(both.rgb.end(), image->rgb.begin() + 27 * y, image->rgb.begin() + 27 * (y + 1));
  save_png(folder / "a.png", both);
  save_png(folder / "b.png", gradient_image(7, 6));
  put(folder / "c.png", "not an image");
  put(folder / "d.txt", "");
  std::vector<std::string> remarks;
  const auto views = saved_renders(folder.path(), 5, remarks);
  REQUIRE(views.size() == 1);
  CHECK(views[0].name == "a");
  CHECK(views[0].truth->rgb == truth.rgb);
  CHECK(views[0].render.rgb == render.rgb);
  CHECK(remarks.size() == 2);
  CHECK(saved_renders(folder / "none", 3, remarks).empty());
}

TEST_CASE("circling camera: looks at the centre of the model from outside", "[report]") {
  SplatModel model(3, 101);
  for (std::size_t i = 0; i < 101; ++i) {
    model.row(0)[i] = 10 + std::cos(static_cast<float>(i));
    model.row(1)[i] = -5 + std::sin(static_cast<float>(i));
  }
  const Camera camera = circling_camera(model, 1.0, 64, 48);
  const auto to_camera = [&](std::array<double, 3> p) {
    std::array<double, 3> out = camera.translation;
    for (std::size_t r = 0; r < 3; ++r)
      for (std::size_t c = 0; c < 3; ++c) out[r] += camera.rotation[3 * r + c] * p[c];
    return out;
  };
  const auto middle = to_camera({10, -5, 0});
  CHECK(middle[0] / middle[2] == Approx(0).margin(0.03));
  CHECK(middle[1] / middle[2] == Approx(0).margin(0.03));
  // For a ring, the expected distance is sqrt(1.05^2 / tan(45 deg / 2)^2 + cos(25 deg)^2). The result may
  // differ by about 0.3 %, because the distance is chosen for only twelve azimuths of the orbit.
  CHECK(middle[2] == Approx(2.692).epsilon(0.006));
  CHECK(camera.time == 0.5);
  CHECK(to_camera({10, -5, 1})[1] < middle[1]);  // the y axis of a camera points down
  const auto& r = camera.rotation;
  const double determinant = r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) +
                             r[2] * (r[3] * r[7] - r[4] * r[6]);
  CHECK(determinant == Approx(1));
  CHECK(circling_camera(SplatModel(3, 0), 0, 8, 8).width == 8);
}
