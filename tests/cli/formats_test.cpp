// SPDX-License-Identifier: Apache-2.0
// Tests `ubs convert` by running the executable, and other subcommands with third-party files and with data
// sets far from the origin.
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/formats/foreign_formats.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "host/formats/zip.hpp"
#include "tests/support/images.hpp"
#include "tests/support/run_ubs.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
using nlohmann::json;
namespace fs = std::filesystem;

namespace {

// Creates a nerfstudio folder in data/. Its nine cameras look at the point (centre, centre, centre).
void put_far_scene(const TempFolder& folder, double centre) {
  std::string frames;
  for (int i = 0; i < 9; ++i) {
    const double a = 0.2 * (i - 4), x = 4 * std::sin(a), z = 4 * std::cos(a);
    frames += fmt::format(
        R"({}{{"file_path": "images/f{}.png", "transform_matrix": [[{:.17g},0,{:.17g},{:.17g}],[0,1,0,{:.17g}],[{:.17g},0,{:.17g},{:.17g}],[0,0,0,1]]}})",
        i ? "," : "", i, std::cos(a), std::sin(a), centre + x, centre, -std::sin(a), std::cos(a), centre + z);
    put_image(folder / fmt::format("data/images/f{}.png", i), 48, 32, i);
  }
  put(folder / "data/transforms.json", R"({"w": 48, "h": 32, "fl_x": 60, "frames": [)" + frames + "]}");
}

ImportedSplats red_ball() {
  ImportedSplats s;
  s.resize(1);
  s.rotations[0] = {1, 0, 0, 0};
  s.log_scales[0] = {-1.5f, -1.5f, -1.5f};
  s.opacity_logits[0] = 6;
  s.sh = {1.7f, -1.7f, -1.7f};
  return s;
}

// Returns a model of the published variant with one splat, which is visible from all directions at all times.
SplatModel faint_ball(int dim) {
  SplatModel model(dim, 1);
  const ParameterLayout l = model.layout();
  for (int row = l.query_beta; row < l.mean; ++row) model.row(row)[0] = -8;
  return model;
}

}  // namespace

TEST_CASE("cli: convert reads and writes many formats, and reports what a format cannot store", "[cli]") {
  const TempFolder folder;
  write_gaussian_ply(folder / "g.ply", red_ball());
  ubs_ok(folder, "convert g.ply u.ply");
  CHECK(to_string(read_splat_ply(folder / "u.ply").variant) ==
        "rot_mode quaternion, kernel gaussian, colour sh0");
  for (const char* arguments :
       {"x.compressed.ply", "X.Compressed.PLY", "x.compressed.ply --to 3dgs", "x.ply.gz --to 3dgs",
        "x.spz.gz", "x.usdz --to usda", "x.gltf --to glb", "x.sog.zip --to sog", "x.ksplat"})
    check_error(folder, fmt::format("convert g.ply {}", arguments), 2, "which cannot be written");
  for (const char* name :
       {"x.compressed.ply", "X.Compressed.PLY", "x.ply.gz", "x.usdz", "x.gltf", "x.sog.zip"})
    CHECK(!std::filesystem::exists(folder / name));
  write_splat_ply(folder / "b.ply", faint_ball(3));
  ubs_ok(folder, "convert b.ply d.ply --to dbs");
  CHECK(detect_splat_format(folder / "d.ply").name == "dbs");
  // Earlier versions wrote the radii of supports as standard deviations of Gaussians, and wrote a DBS file
  // although --to 3dgs requested a 3DGS file.
  for (const char* arguments : {"d.ply o.spz", "d.ply o.ply --to 3dgs"})
    check_error(folder, fmt::format("convert {}", arguments), 2, "convert it to a .ply file first");
  check_error(folder, "convert g.ply o.ply --to dbs", 2,
              "3DGS PLY contains Gaussians, but DBS PLY stores Beta splats");
  ubs_ok(folder, "convert d.ply by_way.ply");
  ubs_ok(folder, "convert by_way.ply by_way.spz");
  CHECK(read_foreign_splats(folder / "by_way.spz").count() == 1);
  write_splat_ply(folder / "u7.ply", faint_ball(7));
  CHECK_THAT(run_ubs(folder, "convert u7.ply d7.ply --to dbs").err, Contains("Beta splats of N = 3"));
  write_splat_ply(folder / "lobes.ply", SplatModel(3, 1, {.colour = ColourMode::sb1}));
  CHECK_THAT(ubs_ok(folder, "convert lobes.ply lobes.spz").out, Contains("Beta lobes are lost"));
  write_splat_ply(folder / "u6.ply", faint_ball(6));
  const std::string still = ubs_ok(folder, "convert u6.ply u6.spz").out;
  CHECK_THAT(still, Contains("rule for the opacity over all view directions") && !Contains("time"));
  // Earlier versions ignored options without effect on the conversion.
  for (const char* arguments :
       {"g.ply o.ply --time 0.5", "g.ply o.spz --opacity max", "u.ply o.ply --to ubs --time 1"})
    check_error(folder, fmt::format("convert {}", arguments), 2,
                "only apply when exporting a ubs model as Gaussians");
  check_error(folder, "convert u.ply o.spz --split train", 2, "--split requires --data");
  for (const char* arguments : {"u.ply o.ply --to ubs", "g.ply o.spz"})
    check_error(folder, fmt::format("convert {} --data data", arguments), 2, "--data is not used here");
  for (const char* option : {"--time 0.5", "--series 3"})
    check_error(folder, fmt::format("convert u.ply o.spz {}", option), 2, "a model that depends on time");
  CHECK(run_ubs(folder, "convert u7.ply n.ply --to 3dgs --time nan").err ==
        "ubs: error: --time nan: must be a finite number\n");
  CHECK(read_splat_ply(folder / "u7.ply").dim == 7);
  ubs_ok(folder, "convert u7.ply x.spz --time 0.5");
  CHECK(read_foreign_splats(folder / "x.spz").count() == 1);
  const std::string background = "convert u7.ply b.spz --overwrite --time 0.5 --background ";
  CHECK_THAT(ubs_ok(folder, background + "1,0.5,0").out, Contains("trained with the background 1,0.5,0, "));
  CHECK(ubs_ok(folder, background + "0,0,0").out.find("background") == std::string::npos);
  // A .ply file of Gaussians has the layout that other programs read. A ubs model also stores the up
  // direction.
  ubs_ok(folder, "convert x.spz theirs.ply");
  CHECK(detect_splat_format(folder / "theirs.ply").name == "3dgs");
  ubs_ok(folder, "convert x.spz ours.ply --to ubs");
  CHECK(load_splat_model(folder / "ours.ply").notes.up == Vec3{0, -1, 0});
  for (const char* model : {"x.spz", "theirs.ply", "ours.ply"}) {
    ubs_ok(folder, fmt::format("web {} --exact --out up.html --overwrite", model));
    const std::string page = get(folder / "up.html"), up = page.substr(page.find("\"up\":["), 60);
    CHECK_THAT(up, Contains(",-1.0,"));
  }
  ubs_ok(folder, "convert x.spz x.splat");
  CHECK(read_foreign_splats(folder / "x.splat").count() == 1);
  ubs_ok(folder, "convert u7.ply x.glb --time 0.5");
  ubs_ok(folder, "convert x.glb x.sog");
  CHECK(json::parse(ubs_ok(folder, "info x.sog --json").out)["format"] == "SOG");
  CHECK(read_foreign_splats(folder / "x.sog").count() == 1);
  // A USD file contains one or several time samples. One of them is read.
  CHECK_THAT(ubs_ok(folder, "convert u7.ply x.usda --time 0.5").out,
             Contains("store K of them with --series K"));
  const json moments = json::parse(ubs_ok(folder, "convert u7.ply x7.usda --series 3 --json").out);
  CHECK(moments["moments"] == 3);
  CHECK(moments["splats"] == 1);
  CHECK(moments["bytes"] == std::filesystem::file_size(folder / "x7.usda"));
  CHECK(!std::filesystem::exists(folder / "x7-000.usda"));
  CHECK_THAT(ubs_ok(folder, "convert u7.ply y7.usda --series 3").out,
             Contains("1 splats at 3 time samples in y7.usda"));
  CHECK_THAT(ubs_ok(folder, "convert x7.usda x7.spz --time 1").out,
             Contains("time codes 0 to 2: the sample at 2 is read"));
  CHECK_THAT(ubs_ok(folder, "convert x7.usda o7.ply --to ubs").out,
             Contains("0 is read; 'ubs convert --time'"));
  CHECK(json::parse(ubs_ok(folder, "info x7.usda --json").out)["format"] == "USD text");
  check_error(folder, "convert x.usda o.spz --time 1", 2, "--time requires a file with time samples");
  check_error(folder, "convert x7.usda o.spz --time 2", 2, "from 0 (first) to 1 (last)");
  check_error(folder, "convert x7.usda o.spz --opacity max", 2, "--time and --opacity only apply");
  check_error(folder, "convert x7.usda o.usda --series 3", 2, "--distill and --series only apply");
  check_error(folder, "convert u7.ply x7.usda --series 3", 2, "--overwrite");
  check_error(folder, "train x7.usda --out r3", 3, "this is a model, not a data set");
  ubs_ok(folder, "convert x.sog X.SPZ");
  CHECK(detect_splat_format(folder / "X.SPZ").name == "spz");
  ubs_ok(folder, "convert X.SPZ X.SPLAT");
  CHECK(read_foreign_splats(folder / "X.SPLAT").count() == 1);
  ubs_ok(folder, "convert u.ply y.ply");
  CHECK(detect_splat_format(folder / "y.ply").name == "3dgs");

  const json info = json::parse(ubs_ok(folder, "info x.spz --json").out);
  CHECK(info["format"] == "SPZ");
  CHECK(info["variant"] == "rot_mode quaternion, kernel gaussian, colour sh0");
  CHECK(info["splats"] == 1);

  CHECK(run_ubs(folder, "convert g.ply x.abc").code == 2);
  CHECK_THAT(run_ubs(folder, "convert g.ply x.abc").err, Contains("choose one with --to"));
  CHECK(run_ubs(folder, "convert none.ply x.spz").code == 3);
  put(folder / "bad.spz", "\x1f\x8b" + std::string(50, 'x'));
  CHECK(run_ubs(folder, "convert bad.spz x.ply").code == 3);
  CHECK_THAT(ubs_ok(folder, "--help").out, Contains("convert"));
}

TEST_CASE("cli: models are converted to another kind of conditioning", "[cli]") {
  const TempFolder folder;
  write_gaussian_ply(folder / "g.ply", red_ball());
  write_splat_ply(folder / "u7.ply", faint_ball(7));
  const json there = json::parse(ubs_ok(folder, "convert u7.ply d.ply --conditioning direct --json").out);
  CHECK(there["variant"] == "cov_param cholesky, conditioning direct");
  CHECK(there["opacity_change_most"] < 1e-9);  // the query dimensions of the model are not correlated
  CHECK(json::parse(ubs_ok(folder, "info d.ply --json").out)["variant"] == there["variant"]);
  ubs_ok(folder, "convert d.ply u.ply --conditioning covariance");
  CHECK(to_string(read_splat_ply(folder / "u.ply").variant) == "cov_param cholesky");
  check_error(folder, "convert d.ply e.ply --conditioning direct", 2, "already has direct conditioning");
  check_error(folder, "convert g.ply e.ply --conditioning direct", 2, "--conditioning only applies");
  ubs_ok(folder, "web d.ply --exact --out page.html");
}

// Without query values, the command would fail with "has 0 further query values".
TEST_CASE("cli: stored cameras of a model with more than seven dimensions get typical query values",
          "[cli]") {
  const TempFolder folder;
  SplatModel model(8, 3);
  for (float& mean : model.row(model.layout().mean + 4)) mean = 0.25f;
  const std::vector<std::string> notes{"ubs_lens 32 24 30 30", "ubs_camera 1 0 0 0 0 0 -4 0"};
  write_splat_ply(folder / "m.ply", model, notes);
  ubs_ok(folder, "web m.ply --exact --out page.html");
  const std::string page = get(folder / "page.html");
  CHECK(page.find("\"extra\":[0.25]") != std::string::npos);
  CHECK(page.find("\"poster\":\"data:image/") != std::string::npos);
  // Without a device, exact pages are still written, but without the preview image.
  const Result without = ubs_ok(folder, "web m.ply --exact --out plain.html --device nonesuch");
  CHECK_THAT(without.err, Contains("the page shows no preview image while it loads: "));
  CHECK(get(folder / "plain.html").find("\"poster\":\"\"") != std::string::npos);
}

TEST_CASE("cli: the files of a series have the same splats in the same order", "[cli]") {
  const TempFolder folder;
  // Three splats, each of which is only visible at one of three times, and one that is never visible.
  SplatModel model(4, 4);
  const ParameterLayout l = model.layout();
  for (std::size_t i = 0; i < 4; ++i) {
    model.row(l.xyz)[i] = 3 - static_cast<float>(i);
    model.row(l.mean)[i] = 0.5f * static_cast<float>(i);
    model.row(l.scale + 3)[i] = -3;
    model.row(l.rgb)[i] = 0.1f * static_cast<float>(i + 1);
    model.row(l.opacity)[i] = 2;
  }
  write_splat_ply(folder / "m.ply", model);
  for (const std::string kind : {"splat", "spz", "sog", "ply", "glb"}) {
    INFO(kind);
    const json said = json::parse(ubs_ok(folder, "convert m.ply f." + kind + " --series 3 --json").out);
    CHECK(said["splats"] == 9);
    for (std::size_t moment = 0; moment < 3; ++moment) {
      const ImportedSplats splats = read_foreign_splats(folder / fmt::format("f-00{}.{}", moment, kind));
      REQUIRE(splats.count() == 3);
      for (std::size_t i = 0; i < 3; ++i) {
        CHECK(splats.positions[i][0] == Approx(3.0 - static_cast<double>(i)).margin(0.01));
        CHECK((splats.opacity_logits[i] > 0) == (i == moment));
      }
    }
  }
}

TEST_CASE("cli: convert distils time samples of a dynamic model from its own renders", "[cli]") {
  const TempFolder folder;
  ubs_ok(folder, "synth orbit --out data --size 40 --views 8 --test-views 1");
  ubs_ok(folder, "train data --out run --dim 7 --iterations 60 --init-points 600 --quiet");
  const json said =
      json::parse(ubs_ok(folder, "convert run g.glb --distill 0.001s --series 2 --degree 1 --json").out);
  REQUIRE(said["distilled"].size() == 2);
  std::size_t splats = 0;
  for (const int moment : {0, 1}) {
    const json& one = said["distilled"][static_cast<std::size_t>(moment)];
    CHECK(one["time"] == moment);
    CHECK(one["iterations"] == 100);  // the minimum, however short the time is
    // The observed increases are 5 to 9 dB.
    CHECK(one["psnr_after"].get<double>() > one["psnr_before"].get<double>() + 2.5);
    const ImportedSplats made = read_foreign_splats(folder / fmt::format("g-00{}.glb", moment));
    CHECK(made.sh_degree == 1);
    CHECK(2 * made.count() == said["splats"]);
    splats += made.count();
  }
  CHECK(said["splats"] == splats);
  // With a single time sample, the file is also measured as other tools render it.
  const Result still = ubs_ok(folder, "convert run s.ply --distill 0.001s --time 1 --json");
  CHECK_THAT(still.err, Contains("data of the run: ") && Contains("renders of the model: "));
  const json loss = json::parse(still.out)["loss"];
  CHECK(loss["cameras"] == 4);
  CHECK(loss["psnr"].get<double>() > loss["psnr_without_fit"].get<double>());
  CHECK_FALSE(json::parse(still.out).contains("psnr_before"));
  // Without --distill, the Gaussians of a series are not fitted, because each time sample would need a fit.
  CHECK_FALSE(json::parse(ubs_ok(folder, "convert run t.glb --series 2 --json").out).contains("distilled"));
  CHECK(run_ubs(folder, "convert run s.ply --to ubs --distill 4s").code == 2);
  CHECK_THAT(run_ubs(folder, "convert run s3.ply --distill 1ms").err, Contains("--distill '1ms' must be"));
  CHECK_THAT(ubs_ok(folder, "convert run s3.ply --distill 0 --no-measure --time -0.5").err,
             Contains("--time -0.5: the model was trained on times from 0 to 1"));
  CHECK_THAT(run_ubs(folder, "convert s.ply s4.spz --distill 4s").err,
             Contains("only apply when exporting a ubs model"));
}

TEST_CASE("cli: convert fits an export to the model, and measures the loss of quality", "[cli]") {
  const TempFolder folder;
  put_far_scene(folder, 0);
  const std::string train =
      "train data --schedule published --iterations 60 --init-points 300 --background 1,0.5,0 --quiet "
      "--test-every 0 ";
  ubs_ok(folder, train + "--dim 6 --out run");
  const Result said = ubs_ok(folder, "convert run m.spz --distill 0");
  CHECK_THAT(said.out, Contains("PSNR against the model: ") && Contains("a black one (mean of 4 cameras)"));
  const json loss =
      json::parse(ubs_ok(folder, "convert run m.spz --distill 0 --json --overwrite").out)["loss"];
  const double psnr = loss["psnr"], on_black = loss["psnr_on_black"];
  CHECK(psnr > 5);
  CHECK(on_black > 5);
  CHECK((std::min(psnr, on_black) < 35) ==
        (said.out.find("fit longer (--distill 60s)") != std::string::npos));
  CHECK_FALSE(json::parse(ubs_ok(folder, "convert run m.spz --distill 0 --json --no-measure --overwrite").out)
                  .contains("loss"));
  CHECK_THAT(ubs_ok(folder, "convert run m.spz --device nonesuch --overwrite").out,
             Contains("the Gaussians were not fitted to the model: ") &&
                 Contains("the loss of quality was not measured: ") && !Contains("PSNR against the model"));
  check_error(folder, "convert run e.spz --distill 2s --device nonesuch", 4, "nonesuch");
  // A fit uses the cameras of the data or, if there are no data, the cameras that the model stores. In both
  // cases, after the minimum of 100 iterations, the Gaussians resemble the model more than before the fit, on
  // its own background and on black.
  const auto fitted = [&](const char* from) {
    const Result result =
        ubs_ok(folder, fmt::format("convert {} f.spz --distill 0.001s --json --overwrite", from));
    INFO(result.err);
    const json there = json::parse(result.out);
    CHECK(there["distilled"].size() == 1);
    CHECK(there["loss"]["psnr_without_fit"].get<double>() == Approx(psnr).margin(0.004));
    // In the two calls, the observed increases are 3.3 and 2.8 dB, and on black 3.4 and 2.9 dB.
    CHECK(there["loss"]["psnr"].get<double>() > psnr + 1.4);
    CHECK(there["loss"]["psnr_on_black"].get<double>() > on_black + 1.4);
    return result.err;
  };
  CHECK_THAT(fitted("run"), Contains("data of the run: "));
  std::filesystem::copy_file(folder / "run/model.ply", folder / "alone.ply");
  CHECK_THAT(fitted("alone.ply"), !Contains("data of the run: "));
  // A .splat file has no harmonics.
  CHECK_FALSE(ubs_ok(folder, "convert run f.splat --distill 0.001s").out.find("harmonics") !=
              std::string::npos);
  // A model of Gaussians loses no quality in a format that does not round values, and little in SPZ, which
  // rounds them.
  ubs_ok(folder, train + "--dim 3 --kernel gaussian --colour sh3 --out gaussians");
  const json exact = json::parse(ubs_ok(folder, "convert gaussians g.ply --json").out);
  CHECK_FALSE(exact.contains("loss"));
  CHECK_FALSE(exact.contains("distilled"));
  check_error(folder, "convert gaussians h.ply --degree 1", 2, "--degree requires that the Gaussians");
  const json rounded = json::parse(ubs_ok(folder, "convert gaussians g.spz --json").out)["loss"];
  CHECK(rounded["psnr"].get<double>() > 35);
  CHECK(rounded["psnr_on_black"].get<double>() > 35);
  CHECK_FALSE(rounded.contains("advice"));
}

TEST_CASE("cli: Gaussians are exported unchanged, and render, eval and gradients read them", "[cli]") {
  const TempFolder folder;
  put_far_scene(folder, 0);
  ImportedSplats ball = red_ball();
  write_gaussian_ply(folder / "g.ply", ball);
  ubs_ok(folder, "convert g.ply u.ply");
  const json out = json::parse(ubs_ok(folder, "convert u.ply h.ply --data data --split train --json").out);
  CHECK_THAT(out["remarks"].dump(), Contains("exported exactly"));
  CHECK(out["psnr_after"].get<double>() == Approx(out["psnr_before"].get<double>()).epsilon(1e-5));
  const ImportedSplats back = read_foreign_splats(folder / "h.ply");
  CHECK(back.sh == ball.sh);
  CHECK(back.opacity_logits == ball.opacity_logits);
  const json in = json::parse(ubs_ok(folder, "convert g.ply v.ply --data data --split train --json").out);
  CHECK(in["psnr"].get<double>() == Approx(out["psnr_before"].get<double>()).epsilon(1e-5));

  ubs_ok(folder, "render g.ply --out around --path-frames 2 --size 40x30");
  const Image8 seen = load_image(folder / "around/frame_0001.png");
  CHECK(seen.width == 40);
  CHECK(int{seen.rgb[3 * (15 * 40 + 20)]} > 200);
  CHECK(run_ubs(folder, "render g.ply --out around --up w").code == 2);

  const std::string on = " --data data --split train";
  ubs_ok(folder, "render g.ply --out r --views 4" + on);
  ubs_ok(folder, "render --model u.ply --out s --views 4" + on);
  CHECK(get(folder / "r/f4.png") == get(folder / "s/f4.png"));
  ubs_ok(folder, "eval g.ply --fps-views 0" + on);
  const json gradient = json::parse(ubs_ok(folder, "gradients g.ply --view 4 --out d.ply --json" + on).out);
  CHECK(gradient["gradient_norms"]["sh0"].get<double>() > 0);
  CHECK(read_splat_ply(folder / "d.ply").variant == read_splat_ply(folder / "u.ply").variant);
}

TEST_CASE("cli: models and data far from the origin are aligned", "[cli]") {
  const TempFolder folder;
  constexpr double kCentre = 5e6;
  put_far_scene(folder, kCentre);
  ImportedSplats ball = red_ball();
  ball.offset = {kCentre + 3, kCentre, kCentre};  // a different origin than that of the data set
  ball.positions[0] = {-3, 0, 0};
  write_gaussian_ply(folder / "g.ply", ball);
  ubs_ok(folder, "convert g.ply u.ply");
  ubs_ok(folder, "render --model u.ply --data data --split train --out r");
  for (const char* view : {"f1", "f4", "f7"}) {  // the ball is in the middle of every view
    const Image8 image = load_image(folder / fmt::format("r/{}.png", view));
    const std::size_t centre = 3 * (16 * 48 + 24), corner = 3 * (2 * 48 + 2);
    CHECK(int{image.rgb[centre]} > 200);
    CHECK(int{image.rgb[centre + 1]} < 40);
    CHECK(int{image.rgb[corner]} == 0);
  }
  const Result trained = ubs_ok(
      folder, "train --data data --out o --iterations 20 --init-points 100 --cap-max 100 --dim 3 --json");
  const json report = json::parse(trained.out);
  CHECK(report["offset"][0].get<double>() == Approx(kCentre).epsilon(1e-6));
  CHECK_THAT(report["data_report"]["notes"].dump(), Contains("far from the origin"));
  std::vector<std::string> comments;
  read_splat_ply(folder / "o/model.ply", &comments);
  CHECK(offset_comment(comments, "o")[0] == report["offset"][0].get<double>());
  ubs_ok(folder, "eval --model o/model.ply --data data");
}

TEST_CASE("cli: masked pixels are ignored in training and evaluation", "[cli]") {
  const TempFolder folder;
  put_far_scene(folder, 0);
  Image8 mask{48, 32, std::vector<std::uint8_t>(3 * 48 * 32, 255)};
  for (std::size_t i = 0; i < 48 * 32; ++i)
    if (i % 48 < 20) std::fill_n(mask.rgb.begin() + static_cast<std::ptrdiff_t>(3 * i), 3, std::uint8_t{0});
  save_png(folder / "data/m.png", mask);
  std::string text = get(folder / "data/transforms.json");
  for (std::size_t at = text.find("{\"file_path\""); at != text.npos;
       at = text.find("{\"file_path\"", at + 20))
    text.insert(at + 1, "\"mask_path\": \"m.png\", ");
  put(folder / "data/transforms.json", text);
  std::filesystem::copy(folder / "data", folder / "other", std::filesystem::copy_options::recursive);
  for (int i = 0; i < 9; ++i) {
    const auto file = folder / fmt::format("other/images/f{}.png", i);
    Image8 image = load_image(file);
    for (std::size_t p = 0; p < image.rgb.size(); ++p)
      if (p / 3 % 48 < 20) image.rgb[p] = static_cast<std::uint8_t>(p * 7 % 256);
    save_png(file, image);
  }
  ubs_ok(folder, "pack data --out set.ubsd");
  const std::string train = "train --iterations 15 --init-points 100 --cap-max 100 --dim 3 --quiet --data ";
  ubs_ok(folder, train + "data --out a");
  ubs_ok(folder, train + "other --out b");
  ubs_ok(folder, train + "set.ubsd --out c");
  CHECK(get(folder / "a/model.ply") == get(folder / "b/model.ply"));
  CHECK(get(folder / "a/model.ply") == get(folder / "c/model.ply"));
  CHECK_THAT(get(folder / "a/metrics.json"), Contains("masked pixels are ignored"));
  const auto mean = [&](const char* data) {
    return json::parse(
        ubs_ok(folder, fmt::format("eval a/model.ply --fps-views 0 --json --data {}", data)).out)["mean"];
  };
  CHECK(mean("data") == mean("other"));
  CHECK(mean("data") == mean("set.ubsd"));
  put(folder / "data/transforms.json", [&] {
    std::string plain = text;
    for (std::size_t at = plain.find("\"mask_path\""); at != plain.npos; at = plain.find("\"mask_path\""))
      plain.replace(at, 11, "\"x\"");
    return plain;
  }());
  CHECK(mean("data") != mean("other"));
  std::fill(mask.rgb.begin(), mask.rgb.end(), std::uint8_t{0});
  save_png(folder / "other/m.png", mask);
  CHECK_THAT(run_ubs(folder, "eval a/model.ply --data other").err, Contains("leaves no pixel"));
  check_error(folder, "train other --test-every 0 --out d", 3, "the masks exclude all pixels of all ");
  check_error(folder, "train other --test-every 1 --out d", 2,
              "--test-every 1 makes every image a test image, so none is left for training");
}

TEST_CASE("cli: a small image cache only changes the memory usage", "[cli]") {
  const TempFolder folder;
  put_far_scene(folder, 0);
  for (int i = 0; i < 9; ++i) put_image(folder / fmt::format("data/images/f{}.png", i), 600, 400, i);
  put(folder / "data/transforms.json", [&] {
    std::string text = get(folder / "data/transforms.json");
    text.replace(text.find("\"w\": 48, \"h\": 32, \"fl_x\": 60"), 28, "\"w\": 600,\"h\": 400,\"fl_x\":700");
    return text;
  }());
  const std::string common =
      "train --data data --iterations 15 --init-points 100 --cap-max 100 --dim 3 --quiet --out ";
  ubs_ok(folder, common + "a");
  ubs_ok(folder, common + "b --image-cache-mb 1");
  CHECK(get(folder / "a/model.ply") == get(folder / "b/model.ply"));
  CHECK_THAT(get(folder / "b/metrics.json"), Contains("decoded on demand"));
}

TEST_CASE("cli: unused parts of files and files without splats are reported", "[cli]") {
  const TempFolder folder;
  write_gaussian_ply(folder / "g.ply", red_ball());
  put(folder / "m.ply",
      replaced(get(folder / "g.ply"), "end_header", "property float filter_3D\nend_header") +
          std::string(4, 'x'));
  for (const char* arguments : {"info m.ply", "convert m.ply u.ply", "convert m.ply m.spz"})
    CHECK_THAT(ubs_ok(folder, arguments).out, Contains("not used: filter_3D") && Contains("Mip-Splatting"));
  CHECK_THAT(json::parse(ubs_ok(folder, "info m.ply --json").out)["remarks"].dump(), Contains("filter_3D"));
  CHECK_THAT(ubs_ok(folder, "render m.ply --out r --path-frames 2 --size 20x10").err, Contains("filter_3D"));
  // Unknown properties of a ubs model are reported too.
  put(folder / "v.ply", replaced(get(folder / "u.ply"), "end_header", "property float surplus\nend_header") +
                            std::string(4, 'x'));
  for (const char* arguments : {"info v.ply", "convert v.ply w.ply", "convert v.ply w.ubs.ply --to ubs"})
    CHECK_THAT(ubs_ok(folder, arguments).out, Contains("not used: surplus"));

  ImportedSplats none = red_ball();
  none.rotations[0] = {0, 0, 0, 0};
  write_gaussian_ply(folder / "none.ply", none);
  for (const char* to : {"o.ply", "o.spz", "o.glb"}) {
    check_error(folder, fmt::format("convert none.ply {}", to), 3, "none of its 1 splats can be rendered");
    CHECK(!std::filesystem::exists(folder / to));
  }
  check_error(folder, "info none.ply", 3, "none of its 1 splats");

  ZipWriter zip;
  for (const char* name : {"images/a.png", "sparse/0/cameras.bin"}) zip.add(name, {});
  const std::vector<std::byte> archive = zip.finish();
  put(folder / "d.zip", {reinterpret_cast<const char*>(archive.data()), archive.size()});
  for (const char* arguments : {"info d.zip", "train d.zip --out r2", "convert d.zip o.ply"})
    check_error(folder, arguments, 3, "a ZIP archive of 2 files, such as 'sparse/0/cameras.bin': unpack it");
  check_error(folder, "train g.ply --out r2", 3, "g.ply: this is a model, not a data set");

  SplatModel model(3, 1,
                   {.rot_mode = RotMode::quaternion,
                    .kernel = SpatialKernel::gaussian,
                    .colour = ColourMode::sh0,
                    .antialias = Antialias::on});
  model.row(model.layout().l_triangle)[0] = 1;
  write_splat_ply(folder / "a.ply", model);
  CHECK(ubs_ok(folder, "convert a.ply b.ply").out.find("antialiasing") == std::string::npos);
  CHECK_THAT(get(folder / "b.ply"), Contains("comment SplatRenderMode: mip\ncomment antialiased 1\n"));
  CHECK_THAT(ubs_ok(folder, "info b.ply").out, Contains("antialias on"));
  CHECK_THAT(ubs_ok(folder, "convert a.ply b.glb").out, Contains("antialiasing"));
}

TEST_CASE("cli: a file without splats is refused by every conversion") {
  const TempFolder folder;
  std::string ply = "ply\nformat binary_little_endian 1.0\nelement vertex 0\n";
  for (const char* name : {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
                           "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"})
    ply += fmt::format("property float {}\n", name);
  put(folder / "empty.ply", ply + "end_header\n");
  for (const std::string& format : written_formats()) {
    if (format == "usdc" || format == "dbs") continue;  // refused before: needs usd-core, or Beta splats
    const fs::path out = fmt::format("out{}", splat_format(format).extension);
    check_error(folder, fmt::format("convert empty.ply {} --to {}", out.string(), format), 3, "no splats");
    CHECK_FALSE(fs::exists(folder / out));
  }
}

TEST_CASE("cli: the output folder of another trainer is opened, and a line says which file is used") {
  const TempFolder folder;
  fs::create_directories(folder / "lfs");
  for (const int step : {7000, 30000})
    write_splat_ply(folder / fmt::format("lfs/splat_{}.ply", step), faint_ball(3));
  const Result result = run_ubs(folder, "info lfs");
  CHECK(result.code == 0);
  CHECK_THAT(result.err, Contains("LichtFeld Studio: using lfs/splat_30000.ply, the last of 2 models"));
}

TEST_CASE("cli: the file with the cameras of another program can be passed instead of its folder") {
  const TempFolder folder;
  put_image(folder / "a.png", 8, 6);
  put(folder / "cameras.csv", "#name,x,y,alt,heading,pitch,roll,f\na.png,1,2,3,10,20,30,35\n");
  CHECK_THAT(ubs_ok(folder, "info cameras.csv --test-every 0").out, Contains("cameras.csv (realitycapture)"));
  put(folder / "other.csv", "#name,x,y,z\na.png,1,2,3\n");
  check_error(folder, "info other.csv", 3, "RealityScan (other.csv)");
}
