// SPDX-License-Identifier: Apache-2.0
// What a new user runs into: models that remember how to be drawn and from where they were seen, folders in
// the place of files, caps that hold, words that are true.
#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/data/image.hpp"
#include "host/data/splat_file.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using nlohmann::json;
using test::check_error;
using test::get;
using test::put;
using test::Result;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

constexpr const char* kShort = "--dim 6 --iterations 60 --init-points 300 --cap-max 300 --quiet --no-plan";

TEST_CASE("a model is drawn as it was learnt, unless an option says otherwise") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 32 --views 6 --test-views 2 --supersampling 1");
  ubs_ok(folder, fmt::format("train --data data --out run --background 1,0.5,0 --eps2d 0.2 {}", kShort));
  const double psnr = json::parse(get(folder / "run/metrics.json"))["test"]["mean"]["psnr"].get<double>();
  fs::copy(folder / "run/model.ply", folder / "alone.ply");
  const auto measured = [&](const std::string& model, const std::string& options) {
    const Result result =
        ubs_ok(folder, fmt::format("eval {} --data data --fps-views 0 --json {}", model, options));
    return std::pair{json::parse(result.out)["mean"]["psnr"].get<double>(), result.err};
  };
  CHECK(measured("alone.ply", "") == std::pair{psnr, std::string()});
  CHECK(measured("run", "").first == psnr);  // its folder will do
  const auto [other, remark] = measured("alone.ply", "--background 0,0,0");
  CHECK(std::abs(other - psnr) > 1);
  CHECK_THAT(remark, Contains("drawn with background = 0,0,0; the model was learnt with 1,0.5,0"));
  // Models made of it remember as well.
  ubs_ok(folder, "reduce --model run --data data --lossless --out small.ply --quiet");
  ubs_ok(folder, "convert run copy.ply --to ubs");
  for (const char* file : {"small.ply", "copy.ply"})
    CHECK(load_splat_model(folder / file).notes.drawing ==
          load_splat_model(folder / "alone.ply").notes.drawing);
  CHECK_THAT(ubs_ok(folder, "info run").out, Contains("background=1,0.5,0"));
  check_error(folder, "eval data --data data", 2, "no model.ply in this folder");
}

TEST_CASE("without data a model is seen from where its cameras were") {
  const TempFolder folder;
  ubs_ok(folder, "synth orbit --out data --size 32 --views 8 --test-views 2 --supersampling 1");
  ubs_ok(folder,
         "train --data data --out run --dim 7 --iterations 60 --init-points 300 --cap-max 300 --quiet");
  ubs_ok(folder, "render run --data data --split train --path train --path-frames 5 --out with");
  ubs_ok(folder, "render run --path train --path-frames 5 --out without");
  for (int i = 0; i < 5; ++i) {
    const std::string name = fmt::format("frame_{:04}.png", i);
    // Eight cameras are all noted; in seven digits.
    const Image8 a = load_image(folder / "with" / name), b = load_image(folder / "without" / name);
    REQUIRE(a.rgb.size() == b.rgb.size());
    for (std::size_t k = 0; k < a.rgb.size(); ++k) CHECK(std::abs(a.rgb[k] - b.rgb[k]) <= 1);
  }
  // Time alone, and a view that is held while time runs.
  ubs_ok(folder, "render run --data data --views 0,1 --time 0.5 --out at");
  CHECK(test::file_count(folder / "at") == 2);
  ubs_ok(folder, "render run --data data --hold 1 --time 0:1 --path-frames 3 --out held");
  const bool moves = get(folder / "held/frame_0000.png") != get(folder / "held/frame_0002.png");
  CHECK(moves);
  const bool same = get(folder / "held/frame_0001.png") == get(folder / "at/r_001.png");
  CHECK(same);
  check_error(folder, "render run --data data --time 0:1 --out x", 2, "belongs to --path or --hold");
  CHECK_THAT(ubs_ok(folder, "render run --data data --views 0 --time 1.5 --out y").err, Contains("0 to 1"));
  check_error(folder, "render run --data data --hold 2 --out x", 2, "there are 2 views");
}

TEST_CASE("cap_max holds, and says so") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 24 --views 4 --test-views 1 --supersampling 1");
  const Result random =
      ubs_ok(folder, "train --data data --out run --dim 3 --iterations 20 --init-points 300 --cap-max 120");
  CHECK_THAT(random.out, Contains("120 initial splats instead of 300: cap_max is 120"));
  CHECK(load_splat_model(folder / "run/model.ply").model.count() == 120);
  std::string points =
      "ply\nformat ascii 1.0\nelement vertex 200\nproperty float x\nproperty float y\n"
      "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
      "end_header\n";
  for (int i = 0; i < 200; ++i) points += fmt::format("{} {} 0 9 9 9\n", 0.01 * i, 0.1 * (i % 7));
  put(folder / "data/points3d.ply", points);
  const Result thinned = ubs_ok(folder, "train --data data --out cloud --dim 3 --iterations 1 --cap-max 120");
  CHECK_THAT(thinned.out, Contains("120 of 200 points taken, evenly spaced"));
  const SplatModel model = load_splat_model(folder / "cloud/model.ply").model.single("test");
  REQUIRE(model.count == 120);
  CHECK(model.row(0)[119] == Approx(0.01 * 198).margin(0.01));
}

TEST_CASE("info counts the views that training will see") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 24 --views 4 --test-views 2 --supersampling 1");
  json scene = json::parse(get(folder / "data/transforms_train.json"));
  scene["w"] = scene["h"] = 24;
  scene["fl_x"] = 30;
  for (json& frame : scene["frames"]) frame["file_path"] = frame["file_path"].get<std::string>() + ".png";
  put(folder / "data/transforms.json", scene.dump());
  for (const char* name : {"transforms_train.json", "transforms_test.json"})
    fs::remove(folder / "data" / name);
  const auto views = [&] {
    const json info = json::parse(ubs_ok(folder, "info data --json").out);
    std::size_t sum = 0;
    for (const auto& split : info["splits"]) sum += split["views"].get<std::size_t>();
    return sum;
  };
  CHECK(views() == 4);
  fs::remove(folder / "data/train/r_001.png");
  CHECK(views() == 3);
  fs::remove_all(folder / "data/train");  // cameras alone
  CHECK(views() == 4);
}

TEST_CASE("an interrupted run does not show an earlier measurement as its own") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 24 --views 4 --test-views 1 --supersampling 1");
  put(folder / "stop.sh",
      fmt::format(
          "'{}' train --data data --out run --dim 3 --iterations 1000000 --init-points 50 --cap-max 50 "
          "--eval-every 50 --log-every 10 --no-plan >out.txt 2>err.txt & pid=$!\n"
          "i=0; until grep -q ',[0-9.]*,0[.][0-9]*$' run/log.csv || [ $i -ge 600 ]; do sleep 0.05; "
          "i=$((i+1)); done\nsleep 0.1; kill -TERM $pid; wait $pid; echo $?\n",
          UBS_EXECUTABLE));
  CHECK(test::run_command(folder, "sh stop.sh").out == "130\n");
  const std::string out = get(folder / "out.txt");
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  INFO(out);
  REQUIRE(metrics["test"].is_object());
  if (metrics["test"]["iteration"] != metrics["iterations"])
    CHECK_THAT(out, Contains(fmt::format(", after iteration {}\n", metrics["test"]["iteration"].get<int>())));
}

TEST_CASE("compare tells devices of one name apart") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 16 --views 2 --test-views 1 --supersampling 1");
  ubs_ok(folder, "train --data data --out run --dim 3 --iterations 1 --init-points 20 --quiet");
  const std::string table =
      ubs_ok(folder, "compare --devices cpu,cpu@gpu --model run --data data --repeat 1").out;
  CHECK_THAT(table, Contains("(opencl, cpu) ") && Contains("(opencl, gpu) "));
}

}  // namespace
}  // namespace ubs
