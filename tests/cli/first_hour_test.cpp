// SPDX-License-Identifier: Apache-2.0
// Tests features that new users need first: models store their render settings and training cameras, commands
// accept folders instead of files, limits are respected, and messages are correct.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "host/dataset/image.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using nlohmann::json;
using test::check_error;
using test::get;
using test::put;
using test::put_scene;
using test::Result;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

// Returns the help page of a command with all its options. Each page is requested only once.
const std::string& whole_help(const std::string& command) {
  static std::map<std::string, std::string> pages;
  std::string& page = pages[command];
  if (page.empty()) page = ubs_ok(TempFolder(), command + " --help-all").out;
  return page;
}

// Returns the lists of commands that `ubs` and `ubs-lab` print if they are called without arguments.
std::string all_commands(const TempFolder& folder) {
  return ubs_ok(folder, "").out + test::run_command(folder, fmt::format("'{}'", UBS_LAB_EXECUTABLE)).out;
}

// With --unit 1, training computes in the unit of the data. So the values of the written model are exactly
// those of training.
constexpr const char* kShort =
    "--dim 6 --schedule published --iterations 60 --init-points 300 --cap-max 300 --unit 1 --quiet";

TEST_CASE("a model is rendered with its training settings, unless an option overrides them") {
  const TempFolder folder;
  put_scene(folder / "data", 32, 6, 2);
  ubs_ok(folder, fmt::format("train --data data --out run --background 1,0.5,0 --eps2d 0.2 {}", kShort));
  const double psnr = json::parse(get(folder / "run/metrics.json"))["test"]["mean"]["psnr"].get<double>();
  fs::copy(folder / "run/model.ply", folder / "alone.ply");
  const auto measured = [&](const std::string& model, const std::string& options) {
    const Result result =
        ubs_ok(folder, fmt::format("eval {} --data data --fps-views 0 --json {}", model, options));
    return std::pair{json::parse(result.out)["mean"]["psnr"].get<double>(), result.err};
  };
  CHECK(measured("alone.ply", "") == std::pair{psnr, std::string()});
  CHECK(measured("run", "").first == psnr);  // the folder of the run is also accepted
  const auto [other, remark] = measured("alone.ply", "--background 0,0,0");
  CHECK(std::abs(other - psnr) > 1);
  CHECK_THAT(remark, Contains("rendering with background = 0,0,0, but the model was trained with 1,0.5,0"));
  // Models that are created from this model also store these settings.
  ubs_ok(folder, "reduce --model run --data data --lossless --out small.ply --quiet");
  ubs_ok(folder, "convert run copy.ply --to ubs");
  for (const char* file : {"small.ply", "copy.ply"})
    CHECK(load_splat_model(folder / file).notes.drawing ==
          load_splat_model(folder / "alone.ply").notes.drawing);
  CHECK_THAT(ubs_ok(folder, "info run").out, Contains("background=1,0.5,0"));
  check_error(folder, "eval data --data data", 2, "no model.ply in this folder");
  fs::rename(folder / "run", folder / "data-ubs");
  check_error(folder, "eval data", 2, "did you mean data-ubs, which was trained on it?");
  check_error(folder, "eval data/", 2, "did you mean data-ubs, which was trained on it?");
}

TEST_CASE("a run stores its data folder and the settings for reading it") {
  const TempFolder folder;
  put_scene(folder / "sets/data", 64, 6, 2);
  ubs_ok(folder, fmt::format("train sets/data --out sets/run --downscale 2 {}", kShort));
  const auto psnr = [](const std::string& text) { return json::parse(text)["mean"]["psnr"].get<double>(); };
  const double trained =
      json::parse(get(folder / "sets/run/metrics.json"))["test"]["mean"]["psnr"].get<double>();
  const Result own = ubs_ok(folder, "eval sets/run --fps-views 0 --json");
  CHECK(psnr(own.out) == trained);
  CHECK_THAT(own.err, Contains("data of the run: "));
  CHECK(json::parse(own.out)["data"].get<std::string>().ends_with("sets/data"));
  // Options and a data folder that are given take precedence.
  CHECK(psnr(ubs_ok(folder, "eval sets/run --downscale 1 --fps-views 0 --json").out) != trained);
  CHECK(psnr(ubs_ok(folder, "eval sets/run sets/data --downscale 2 --fps-views 0 --json").out) == trained);
  // Rendered images also have the size of the images with which the run was trained.
  ubs_ok(folder, "render sets/run sets/data --views 0 --out drawn");
  const fs::path picture = folder / "drawn/r_000.png";
  CHECK(load_image(picture).width == 32);
  ubs_ok(folder, "render sets/run sets/data --views 0 --downscale 1 --out drawn --overwrite");
  CHECK(load_image(picture).width == 64);
  ubs_ok(folder, "gradients sets/run --view 0 --out gradients.ply");
  ubs_ok(folder, "reduce sets/run --lossless --out small.ply --quiet");
  CHECK_THAT(ubs_ok(folder, "compare --devices cpu sets/run --repeat 1").out, Contains("cpu"));
  ubs_ok(folder, "web sets/run sets/data --exact --out page.html");
  CHECK(get(folder / "page.html").find("\"width\":32") != std::string::npos);
  const json exported =
      json::parse(ubs_ok(folder, "convert sets/run e.spz --data sets/data --distill 0 --json").out);
  CHECK(exported["psnr_before"] == trained);
  // The working folder of the command contains a different folder with the name of the data of the run.
  put(folder / "x/sets/data/notes.txt", "no data");
  fs::create_directory_symlink(".", folder / "sets/sets");
  const Result besides = test::run_command(
      folder, fmt::format("(cd x && '{}' eval ../sets/run --fps-views 0 --json)", UBS_EXECUTABLE));
  INFO(besides.err);
  REQUIRE(besides.code == 0);
  CHECK(psnr(besides.out) == trained);
  const Result inside = test::run_command(
      folder, fmt::format("(cd sets/run && '{}' eval model.ply --fps-views 0 --json)", UBS_EXECUTABLE));
  INFO(inside.err);
  REQUIRE(inside.code == 0);
  CHECK(psnr(inside.out) == trained);
  // Three errors are tested: a model without its run, a run whose data folder does not exist, and, at the end
  // of this test, a run whose data were replaced by different data.
  fs::copy(folder / "sets/run/model.ply", folder / "alone.ply");
  check_error(folder, "eval alone.ply", 2, "no data folder given");
  fs::rename(folder / "sets/data", folder / "sets/elsewhere");
  check_error(folder, "eval sets/run", 3, "does not exist");
  // The same data in another folder are read with the settings of the training.
  const Result moved = ubs_ok(folder, "eval sets/run sets/elsewhere --fps-views 0 --json");
  CHECK(psnr(moved.out) == trained);
  CHECK_THAT(moved.err, Contains("sets/elsewhere is the data that the run was trained on, and is read with "
                                 "the settings of the run"));
  put_scene(folder / "sets/data", 64, 5, 2);
  check_error(folder, "eval sets/run", 3, "other cameras, names or images");
  put(folder / "sets/run/metrics.json", "{}");
  check_error(folder, "eval sets/run", 3, "metrics.json: does not name the data folder of the run");
}

// The table contains each command that `ubs` or `ubs-lab` lists and whose help mentions a model or a run,
// with the arguments that the command needs in addition to the folder.
TEST_CASE("every command that accepts a model accepts the folder of a run, and finds the data of the run") {
  const TempFolder folder;
  put_scene(folder / "sets/data", 32, 6, 2);
  ubs_ok(folder, fmt::format("train sets/data --out sets/run --downscale 2 {}", kShort));
  const std::map<std::string, std::string> rest{
      {"accuracy", "--quick --config math=native --out accuracy --quiet"},
      {"bench", "--list"},
      {"compare", "--devices cpu --repeat 1"},
      {"convert", "copy.spz --distill 0"},
      {"eval", "--fps-views 0"},
      {"gradients", "--view 0 --out gradients.ply"},
      {"info", ""},
      {"plan", "--model"},
      {"reduce", "--lossless --out small.ply --quiet"},
      {"render", "--out pictures"},
      {"report", "--out report.html"},
      {"tune", "--quick --dry-run --max-time 0.01"},
      {"view", "--port 0"},
      {"web", "--out page.html"}};
  std::istringstream lines(all_commands(folder));
  std::set<std::string> seen;
  for (std::string line, command; std::getline(lines, line);) {
    if (!line.starts_with("  ") || line[2] == ' ') continue;
    std::istringstream(line) >> command;
    if (command == "stress") continue;  // Catch2 reads the options of this command
    const std::string& help = whole_help(command);
    const std::string options = help.substr(std::min(help.find("Positionals:"), help.find("Options:")));
    const bool takes = std::ranges::any_of(
        std::array{"model of any format", "--model", "output folder of 'ubs train'", "RUN"},
        [&](const char* word) { return options.find(word) != options.npos; });
    if (!takes) continue;
    INFO(command);
    seen.insert(command);
    REQUIRE(rest.contains(command));
    const std::string& more = rest.at(command);
    if (command == "view") {  // it only ends if it is interrupted, except in a build without a server
      const int code = test::ended_by(folder, fmt::format("view sets/run {}", more), SIGINT, "err.txt",
                                      "env -u DISPLAY -u WAYLAND_DISPLAY");
      const std::string said = get(folder / "err.txt");
      INFO(said);
      CHECK((said.find("no HTTP server") == said.npos ? code == 130 : code == 2));
      continue;
    }
    const bool last = more.ends_with("--model");
    const Result result = run_ubs(folder, last ? fmt::format("{} {} sets/run", command, more)
                                               : fmt::format("{} sets/run {}", command, more));
    INFO(result.err);
    CHECK(result.code == 0);
  }
  CHECK(seen.size() == rest.size());
  // Data of a run are read with the settings of the run.
  CHECK_THAT(ubs_ok(folder, "bench sets/run --list").out, Contains("model.300.16x16"));
}

TEST_CASE("the data of a run are found from every folder, also after they were moved with the run") {
  const TempFolder folder;
  put_scene(folder / "all/sets/data", 32, 6, 2);
  fs::create_directories(folder / "all/start");
  fs::create_directories(folder / "far/away");
  const auto ok = [&](const std::string& where, const std::string& arguments) {
    const Result result = test::run_command(
        folder, fmt::format("(cd '{}' && '{}' {})", where, test::program_of(arguments), arguments));
    INFO(where << ": " << arguments << "\n" << result.err);
    CHECK(result.code == 0);
    return result;
  };
  ok("all/start", fmt::format("train ../sets/data --out ../runs/deep/one {}", kShort));
  for (const char* moved : {"all", "moved"}) {
    if (!fs::exists(folder / moved)) fs::rename(folder / "all", folder / moved);
    const std::string run = fmt::format("../../{}/runs/deep/one", moved);
    for (const char* more :
         {"eval {} --fps-views 0", "reduce {} --lossless --out ../small.ply --overwrite --quiet",
          "compare {} --devices cpu --repeat 1", "convert {} ../copy.spz --distill 0 --overwrite"})
      CHECK_THAT(ok("far/away", fmt::format(fmt::runtime(more), run)).err,
                 Contains("data of the run: ") && Contains(fmt::format("{}/sets/data", moved)));
    CHECK_THAT(ok("far/away", fmt::format("report {} --out ../{}.html", run, moved)).err,
               !Contains("data folder"));
  }
  // The same holds for a run that is resumed.
  ok("moved/start",
     fmt::format("train ../sets/data --out ../runs/deep/two {} --checkpoint-every 10", kShort));
  fs::rename(folder / "moved/runs/deep/two/continue.ubs", folder / "moved/runs/deep/two/checkpoint.ubs");
  fs::rename(folder / "moved", folder / "again");
  ok("far/away", "train --resume ../../again/runs/deep/two --quiet");
}

TEST_CASE("without data, a model is rendered from its stored training cameras") {
  const TempFolder folder;
  put_scene(folder / "data", 32, 8, 2, "orbit");
  ubs_ok(folder,
         "train --data data --out run --dim 7 --iterations 60 --init-points 300 --cap-max 300 --quiet");
  ubs_ok(folder, "render run --data data --split train --path train --path-frames 5 --out with");
  ubs_ok(folder, "render run --path train --path-frames 5 --out without");
  for (int i = 0; i < 5; ++i) {
    const std::string name = fmt::format("frame_{:04}.png", i);
    // The model stores all eight cameras, with seven digits per number.
    const Image8 a = load_image(folder / "with" / name), b = load_image(folder / "without" / name);
    REQUIRE(a.rgb.size() == b.rgb.size());
    for (std::size_t k = 0; k < a.rgb.size(); ++k) CHECK(std::abs(a.rgb[k] - b.rgb[k]) <= 1);
  }
  // Tests images at another time, and a fixed view while time advances.
  ubs_ok(folder, "render run --data data --views 0,1 --time 0.5 --out at");
  CHECK(test::file_count(folder / "at") == 2);
  ubs_ok(folder, "render run --data data --hold 1 --time 0:1 --path-frames 3 --out held");
  const bool moves = get(folder / "held/frame_0000.png") != get(folder / "held/frame_0002.png");
  CHECK(moves);
  const bool same = get(folder / "held/frame_0001.png") == get(folder / "at/r_001.png");
  CHECK(same);
  check_error(folder, "render run --data data --time 0:1 --out x", 2, "requires --path or --hold");
  CHECK_THAT(ubs_ok(folder, "render run --data data --views 0 --time 1.5 --out y").err, Contains("0 to 1"));
  check_error(folder, "render run --data data --hold 2 --out x", 2, "choose a view below 2");
  check_error(folder, "render run --path train --distance 3 --out x", 2,
              "only applies to --path orbit and --path spiral");
  check_error(folder, "render run --path train --up z --out x", 2, "--up does not apply to this path");
}

TEST_CASE("cap_max is respected and reported") {
  const TempFolder folder;
  put_scene(folder / "data", 24, 4, 1);
  const Result random =
      ubs_ok(folder, "train --data data --out run --dim 3 --iterations 20 --init-points 300 --cap-max 120");
  CHECK_THAT(random.out, Contains("using 120 initial splats instead of 300, because cap_max is 120"));
  CHECK(load_splat_model(folder / "run/model.ply").model.count() == 120);
  std::string points =
      "ply\nformat ascii 1.0\nelement vertex 200\nproperty float x\nproperty float y\n"
      "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
      "end_header\n";
  for (int i = 0; i < 200; ++i) points += fmt::format("{} {} 0 9 9 9\n", 0.01 * i, 0.1 * (i % 7));
  put(folder / "data/points3d.ply", points);
  const Result thinned = ubs_ok(folder, "train --data data --out cloud --dim 3 --iterations 1 --cap-max 120");
  CHECK_THAT(thinned.out, Contains("using 120 of 200 points, evenly spaced"));
  const SplatModel model = load_splat_model(folder / "cloud/model.ply").model.single("test");
  REQUIRE(model.count == 120);
  CHECK(model.row(0)[119] == Approx(0.01 * 198).margin(0.01));
}

TEST_CASE("info counts the views that training will use") {
  const TempFolder folder;
  put_scene(folder / "data", 24, 4, 2);
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
  // Without any images, the cameras alone are not sufficient.
  for (const char* name : {"train", "test"}) fs::remove_all(folder / "data" / name);
  check_error(folder, "info data --json", 3, "none of the 4 images exists");
}

TEST_CASE("an interrupted run states the iteration at which its test views were last measured") {
  const TempFolder folder;
  put_scene(folder / "data", 24, 4, 1);
  put(folder / "stop.sh",
      fmt::format(
          "'{}' train --data data --out run --dim 3 --iterations 1000000 --init-points 50 --cap-max 50 "
          "--eval-every 50 --log-every 10 >out.txt 2>err.txt & pid=$!\n"
          "i=0; until grep -q ',[0-9.]*,0[.][0-9]*,,$' run/log.csv || [ $i -ge 12000 ]; do sleep 0.05; "
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

TEST_CASE("compare distinguishes devices with the same name") {
  const TempFolder folder;
  put_scene(folder / "data", 16, 2, 1);
  ubs_ok(folder, "train --data data --out run --dim 3 --iterations 1 --init-points 20 --quiet");
  const std::string table =
      ubs_ok(folder, "compare --devices cpu,cpu@gpu --model run --data data --repeat 1").out;
  CHECK_THAT(table, Contains("(opencl, cpu) ") && Contains("(opencl, gpu) "));
}

TEST_CASE("without points, splats start where the cameras look") {
  const TempFolder folder;
  put_scene(folder / "data", 24, 6, 1);
  const std::string train = "train data --dim 3 --iterations 1 ";
  CHECK_THAT(ubs_ok(folder, train + "--out a").out,
             Contains("the data have no points: splats start at random positions in the cube that all "
                      "cameras see") &&
                 Contains("begins   192 splats"));
  CHECK_THAT(ubs_ok(folder, train + "--out b --init-extent 0.5 --init-points 50").out,
             Contains("at random positions within 0.5 of the origin") && Contains("begins   50 splats"));
  const SplatModel box = load_splat_model(folder / "b/model.ply").model.single("test");
  for (int axis = 0; axis < 3; ++axis)
    for (const float x : box.row(axis)) CHECK(std::abs(x) < 0.51f);  // one step moves them by 1e-3
  // If the scene is moved, splats start at its new position.
  for (const char* split : {"train", "test"}) {
    const fs::path file = folder / fmt::format("data/transforms_{}.json", split);
    json scene = json::parse(get(file));
    for (json& frame : scene["frames"])
      frame["transform_matrix"][0][3] = frame["transform_matrix"][0][3].get<double>() + 50;
    put(file, scene.dump());
  }
  ubs_ok(folder, train + "--out c");
  const SplatModel moved = load_splat_model(folder / "c/model.ply").model.single("test");
  for (const float x : moved.row(0)) CHECK(std::abs(x - 50) < 5);
}

TEST_CASE("initial splats are found by comparing images, and config.yaml reproduces them") {
  const TempFolder folder;
  put_scene(folder / "data", 200, 24, 1);
  const Result first = ubs_ok(folder, "train data --dim 3 --out a --budget 20s --cap-max 1200");
  CHECK_THAT(first.out,
             Contains("initial points found by comparing images") && Contains("begins   1200 splats"));
  ubs_ok(folder, "train data --spec a/config.yaml --out b");
  CHECK(get(folder / "a/model.ply") == get(folder / "b/model.ply"));
  // With a long budget, find_points would be larger.
  CHECK_THAT(get(folder / "a/config.yaml"), Contains("\nfind_points: 20000"));
  CHECK_THAT(ubs_ok(folder, "train data --dim 3 --out g --iterations 1 --set find_points=0").out,
             !Contains("initial points found"));
  CHECK_THAT(ubs_ok(folder, "train data --dim 3 --out c --iterations 1 --init-points 70").out,
             Contains("begins   70 splats") && !Contains("initial points found"));
  CHECK_THAT(first.err, !Contains("exposure"));
  for (int i = 0; i < 24; i += 2) {
    const fs::path file = folder / fmt::format("data/train/r_{:03}.png", i);
    Image8 image = load_image(file);
    for (std::uint8_t& value : image.rgb) value = static_cast<std::uint8_t>(0.7 * value);
    save_png(file, image);
  }
  const std::string uneven = "train data --dim 3 --iterations 1 --cap-max 100 --out ";
  CHECK_THAT(ubs_ok(folder, uneven + "d").err, Contains("exposure") && Contains("--appearance gain"));
  CHECK_THAT(ubs_ok(folder, uneven + "e --appearance gain").err, !Contains("exposure"));
  CHECK_THAT(ubs_ok(folder, "train --help").out, Contains("--find-points INT"));
}

TEST_CASE("a model that overfits its training images is reported") {
  const TempFolder folder;
  put_scene(folder / "data", 32, 3, 3);
  const std::string train = "train data --dim 3 --init-points 2000 --cap-max 2000 --unit 1 --out ";
  CHECK_THAT(ubs_ok(folder, train + "run --iterations 1000").out, Contains("overfit  training views have "));
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  CHECK(metrics["train"]["views"].size() == 3);
  const json measured = json::parse(ubs_ok(folder, "eval run --split train --json").out);
  CHECK(measured["mean"]["psnr"] == metrics["train"]["mean"]["psnr"]);
  CHECK_THAT(ubs_ok(folder, train + "short --iterations 10").out, !Contains("overfit"));
}

TEST_CASE("ubs train FOLDER chooses an output folder and all settings that are not given, and reports them") {
  const TempFolder folder;
  put_scene(folder / "sets/data", 24, 6, 1, "orbit");
  const std::string few = " --iterations 1 --init-points 50";
  put(folder / "sets/data-ubs/.ubs-lock", "");  // left by Ctrl-C before the first step
  const Result first = ubs_ok(folder, "train sets/data/" + few);
  CHECK_THAT(first.out, Contains("sets/data-ubs (choose another folder with --out)") &&
                            Contains("dim auto: N = 7") && Contains("kernels  compiled in") &&
                            Contains("next     ubs report"));
  CHECK(fs::exists(folder / "sets/data-ubs/model.ply"));
  const json metrics = json::parse(get(folder / "sets/data-ubs/metrics.json"));
  CHECK(metrics["dim"] == 7);
  CHECK(metrics["kernel_seconds"].get<double>() > 0);
  for (const char* key : {"dim", "unit", "conditioning", "background", "random_background", "cap_max"})
    CHECK_THAT(metrics["chosen"].dump(), Contains(fmt::format("\"{}\"", key)));
  CHECK_THAT(first.out,
             Contains("direct conditioning (for the published variant: --conditioning covariance)"));
  const auto conditioning = [&](const std::string& run) {
    return json::parse(get(folder / run / "metrics.json"))["settings"]["conditioning"].get<std::string>();
  };
  CHECK(conditioning("sets/data-ubs") == "direct");
  CHECK_THAT(ubs_ok(folder, "train sets/data --out 'my run' --conditioning covariance" + few).out,
             Contains("ubs report 'my run' (HTML report)"));
  CHECK(conditioning("my run") == "covariance");
  ubs_ok(folder, "train sets/data --out seven --dim 7" + few);
  CHECK(conditioning("seven") == "covariance");
  // Existing files are never overwritten, even if ubs did not create them.
  put(folder / "sets/data-ubs-2/mine.txt", "mine");
  ubs_ok(folder, "train sets/data" + few);
  CHECK(fs::exists(folder / "sets/data-ubs-3/model.ply"));
  CHECK(get(folder / "sets/data-ubs-2/mine.txt") == "mine");
  check_error(folder, "train", 2, "ubs train FOLDER");
  check_error(folder, "train nowhere", 3, "no such data folder");
  CHECK(!fs::exists(folder / "nowhere-ubs"));
  // A user may choose a dimension without time, which gives a warning.
  CHECK_THAT(ubs_ok(folder, "train sets/data --dim 6" + few).err, Contains("N = 6 has no time dimension"));
  // The report marks the settings that the user chose, but not those that `ubs train` chose from the data.
  const json record = json::parse(ubs_ok(folder, "report sets/data-ubs --json").out);
  const json& run = record["runs"].at(0);
  const auto by_data = [&](const std::string& key) {
    const json& chosen = run["metrics"]["chosen"];
    return std::find(chosen.begin(), chosen.end(), json(key)) != chosen.end();
  };
  CHECK(run["settings"]["iterations"] != record["defaults"]["iterations"]);
  CHECK_FALSE(by_data("iterations"));
  for (const char* key : {"dim", "conditioning", "init_extent", "cap_max", "noise_lr", "lr_opacity"}) {
    INFO(key);
    CHECK((by_data(key) || run["settings"][key] == record["defaults"][key]));
  }
}

// Starts `ubs train`, ends it when it has printed a line that starts with `last`, and returns its output.
std::string said_at_begin(const TempFolder& folder, const std::string& arguments,
                          const std::string& last = "begins") {
  put(folder / "stop.sh",
      fmt::format(": >out.txt\n"  // so that the output of an earlier training is not found
                  "'{}' train {} >out.txt 2>err.txt & pid=$!\n"
                  "i=0; until grep -q '^{}' out.txt || [ $i -ge 6000 ]; do sleep 0.1; i=$((i+1)); done\n"
                  "sleep 0.2; kill -TERM $pid; wait $pid; echo $?\n",
                  UBS_EXECUTABLE, arguments, last));
  CHECK(test::run_command(folder, "sh stop.sh").out == "130\n");
  return get(folder / "out.txt");
}

TEST_CASE("without --iterations and --budget, a run announces a budget of 15 minutes") {
  const TempFolder folder;
  put_scene(folder / "data", 64, 8, 1);
  CHECK_THAT(said_at_begin(folder, "data --dim 6 --out whole --cap-max 100 --init-points 50"),
             Contains(" that are left of 15 min, at most 100 splats") &&
                 Contains("--schedule published for the published rates"));
  CHECK_THAT(get(folder / "whole/config.yaml"), Contains("\npyramid: '") && Contains("\ncap_max: 100 "));
}

TEST_CASE("a plan without --iterations and --budget estimates the default training") {
  const TempFolder folder;
  put_scene(folder / "data", 64, 8, 1);
  const std::string few = "plan data --dim 6 --cap-max 100 --init-points 50 ";
  const Result text = ubs_ok(folder, few);
  CHECK_THAT(text.out, Contains("schedule   16000 iterations, at most 100 splats\n") &&
                           Contains("would take longer than 15 min\n") &&
                           Contains("16000 iterations at the measured"));
  const json plan = json::parse(ubs_ok(folder, few + "--json").out);
  CHECK(plan["iterations"] == 16000);
  CHECK(plan["settings"]["iterations"] == 16000);
  CHECK(plan["settings"]["lr_rgb"] == 0.00241);  // the rate for 16 000 iterations
  CHECK(plan["settings"]["cap_max"] == 100);
  CHECK(plan["budget_seconds"] == 900);
  // The published schedule has another length and other rates, and no time limit.
  const json published = json::parse(ubs_ok(folder, few + "--schedule published --json").out);
  CHECK(published["iterations"] == 30000);
  CHECK(published["settings"]["lr_rgb"] == 0.001);
  CHECK(published["budget_seconds"].is_null());
  CHECK_THAT(ubs_ok(folder, few + "--set iterations=30000").out, !Contains("schedule "));
}

TEST_CASE("folders and models can be passed without option names") {
  const TempFolder folder;
  put_scene(folder / "data", 24, 4, 1);
  ubs_ok(folder, "train data --out run --dim 3 --iterations 1 --init-points 20 --quiet");
  CHECK_THAT(ubs_ok(folder, "bench run data --list").out, Contains("iteration.model.20.24x24"));
  CHECK_THAT(ubs_ok(folder, "plan data --dim 3 --iterations 10 --init-points 20").out,
             Contains("10 iterations at the measured") && Contains("largest buffer") && Contains(": fits\n"));
  CHECK_THAT(ubs_ok(folder, "compare --devices cpu run data --repeat 1").out, Contains("cpu"));
  ubs_ok(folder, "train --dim 3 --set iterations=1 data --out set --init-points 20 --quiet");
  // The message must explain these files, instead of reporting an unexpected argument.
  check_error(folder, "accuracy run nowhere --out a", 3, "nowhere");
  check_error(folder, "tune run nowhere --dry-run", 3, "nowhere");
}

// In every example of the help, the command accepts the options and gets all required arguments.
TEST_CASE("help: examples are valid commands") {
  const TempFolder folder;
  std::istringstream lines(all_commands(folder));
  int examples = 0;
  const std::regex example_line("  +(ubs|ubs-lab) ([a-z]+).*");
  std::smatch found;
  for (std::string line, word; std::getline(lines, line);) {
    if (!std::regex_match(line, found, example_line)) continue;
    if (found[2] == "stress") continue;
    const std::string command = found[2], typed = "  " + found[1].str() + " " + command;
    const std::string& help = whole_help(command);
    const std::string options = help.substr(help.find("Options:"));
    for (std::size_t from = help.find(typed); from != std::string::npos;
         from = help.find("\n" + typed, from + 1)) {
      const std::size_t start = help.find("ubs", from);
      const std::string example = help.substr(start, help.find('\n', start) - start);
      INFO(example);
      ++examples;
      for (std::istringstream words(example); words >> word;)
        if (word.starts_with("--")) CHECK_THAT(options, Contains(word));
      std::istringstream rows(options);
      for (std::string row; std::getline(rows, row);)
        if (row.find("REQUIRED") != std::string::npos && std::istringstream(row) >> word)
          CHECK_THAT(example, Contains(word));
    }
  }
  CHECK(examples >= 40);
}

TEST_CASE("help: pages have groups and examples, and list few options unless all are requested") {
  const TempFolder folder;
  const std::string alone = ubs_ok(folder, "").out;
  for (const char* part : {"First steps:", "Learn:", "Look:", "Convert:", "Devices:", "ubs train photos",
                           "ubs devices --doctor"})
    CHECK_THAT(alone, Contains(part));
  // The list starts with the commands that users need first.
  std::vector<std::size_t> at;
  for (const char* command : {"\n  train ", "\n  view ", "\n  render ", "\n  cameras ", "\n  report "})
    at.push_back(alone.find(command));
  CHECK(std::ranges::is_sorted(at));
  CHECK(at.back() < alone.size());
  CHECK(alone.find("Exit codes") == std::string::npos);
  CHECK_THAT(ubs_ok(folder, "--help-all").out, Contains("Exit codes:\n  0 "));
  const std::string help = ubs_ok(folder, "train --help").out, &all = whole_help("train");
  CHECK(ubs_ok(folder, "help train").out == help);
  CHECK(ubs_ok(folder, "help").out == ubs_ok(folder, "--help").out);
  check_error(folder, "help trane", 2, "did you mean 'train'?");
  CHECK(std::count(help.begin(), help.end(), '\n') < 60);
  CHECK(help.find("Examples:") < help.find("--cap-max"));
  CHECK_THAT(help, Contains("more options: ubs train --help-all") && !Contains("--lr-rgb") &&
                       !Contains("Exit codes"));
  CHECK_THAT(all, Contains("--lr-rgb") && Contains("--lambda-dssim") && Contains("Exit codes:\n  0 "));
  for (const std::string& page : {help, ubs_ok(folder, "plan --help").out})
    CHECK_THAT(page, Contains("differ between the training views [auto]"));
  const std::string eval = ubs_ok(folder, "eval --help").out;
  CHECK(eval.find("REQUIRED", eval.find("Positionals:")) != std::string::npos);
  CHECK(eval.find("--model", eval.find("Options:")) == std::string::npos);
  check_error(folder, "train --iteratons 9", 2, "did you mean --iterations?");
  for (const char* wrong : {"eval run --quiet", "metrics a b --seed 1", "info x --fast"}) {
    INFO(wrong);
    CHECK_THAT(run_ubs(folder, wrong).err, !Contains("did you mean"));
  }
}

// A script that replaces COLMAP. It checks its arguments, and copies the models in small/ and large/.
constexpr const char* kColmap = R"(#!/bin/sh
echo "$@" >>calls.txt
case "$1" in
feature_extractor)
  [ "$2" = -h ] && { echo "  --SiftExtraction.use_gpu arg"; exit 0; }
  case "$*" in *"--SiftExtraction.use_gpu 0"*) ;; *) exit 9;; esac
  [ -e photos/colmap/images.txt ] || exit 8
  echo "Processed file [1/3]"; echo x >photos/colmap/database.db ;;
exhaustive_matcher | sequential_matcher)
  [ -e fail ] && { echo "the matcher broke"; exit 3; }
  [ -e photos/colmap/database.db ] || exit 7 ;;
mapper)
  mkdir -p photos/colmap/mapping/0 photos/colmap/mapping/1
  cp small/* photos/colmap/mapping/0; cp large/* photos/colmap/mapping/1 ;;
esac
)";

std::string u64(std::uint64_t n) { return {reinterpret_cast<const char*>(&n), 8}; }
template <typename T>
std::string raw(T value) {
  return {reinterpret_cast<const char*>(&value), sizeof value};
}

void put_colmap_model(const fs::path& folder, int images) {
  put(folder / "cameras.bin",
      u64(1) + raw(1) + raw(1) + u64(16) + u64(12) + raw(20.0) + raw(20.0) + raw(8.0) + raw(6.0));
  std::string text = u64(static_cast<std::uint64_t>(images));
  for (int i = 0; i < images; ++i) {
    text +=
        raw(i + 1) + raw(1.0) + raw(0.0) + raw(0.0) + raw(0.0) + raw(0.1 * i) + raw(0.0) + raw(4.0) + raw(1);
    text += fmt::format("p{}.png", i) + std::string(1, '\0') + u64(0);
  }
  put(folder / "images.bin", text);
  put(folder / "points3D.bin", u64(0));
}

TEST_CASE("photographs are trained with their mean colour as the background, unless another is chosen") {
  const TempFolder folder;
  Image8 picture{16, 12, {}};
  for (int i = 0; i < 16 * 12; ++i)
    for (const int value : {i, 2 * i % 256, 51}) picture.rgb.push_back(static_cast<std::uint8_t>(value));
  put_colmap_model(folder / "photos/sparse/0", 3);
  fs::create_directories(folder / "photos/images");
  for (int i = 0; i < 3; ++i) save_png(folder / fmt::format("photos/images/p{}.png", i), picture);
  const std::string train = "photos --dim 3 --init-points 20 --test-every 0 --out ";
  CHECK_THAT(said_at_begin(folder, train + "mean"), Contains("background 0.37,0.41,0.2: the mean colour"));
  CHECK_THAT(get(folder / "mean/config.yaml"), Contains("\nbackground: [0.37,0.41,0.2] "));
  for (const char* chosen : {"0,0,0", "1,1,1"}) {
    CHECK(said_at_begin(folder, train + "run --overwrite --background " + chosen).find("mean colour") ==
          std::string::npos);
    CHECK_THAT(get(folder / "run/config.yaml"), Contains(fmt::format("\nbackground: [{}] ", chosen)));
  }
}

TEST_CASE("a learnt background requires opaque images and is stored in the model") {
  const TempFolder folder;
  Image8 picture{16, 12, {}, {}};
  for (int i = 0; i < 16 * 12; ++i)
    for (const int value : {i, 2 * i % 256, 51}) picture.rgb.push_back(static_cast<std::uint8_t>(value));
  put_colmap_model(folder / "photos/sparse/0", 4);
  fs::create_directories(folder / "photos/images");
  for (int i = 0; i < 4; ++i) save_png(folder / fmt::format("photos/images/p{}.png", i), picture);
  for (const std::string learnt : {"sky", "learn"}) {
    const std::string out = learnt + "-run";
    const std::string said =
        ubs_ok(
            folder,
            fmt::format(
                "train photos --dim 3 --init-points 50 --cap-max 50 --iterations 60 --unit 1 --test-every 2 "
                "--background {} --out {}",
                learnt, out))
            .out;
    CHECK_THAT(said, Contains("trained  background 0."));
    CHECK_THAT(get(folder / (out + "/config.yaml")), Contains("background: " + learnt + "  #"));
    const json trained = json::parse(get(folder / (out + "/metrics.json")));
    const std::string found = trained["learnt_background"];
    CHECK(std::ranges::count(found, ',') == (learnt == "sky" ? 26 : 2));
    CHECK_THAT(get(folder / (out + "/model.ply")), Contains("background=" + found));
    // Tests the model file alone, and as part of a run whose settings contain `sky` or `learn`.
    for (const std::string& model : {out + "/model.ply photos --test-every 2", out}) {
      const json measured = json::parse(ubs_ok(folder, "eval " + model + " --json").out);
      for (const char* figure : {"psnr", "psnr_joint", "ssim"})
        CHECK(measured["mean"][figure] == trained["test"]["mean"][figure]);
    }
    const std::string exported =
        ubs_ok(folder, fmt::format("convert {0}/model.ply {0}.spz --distill 0", out)).out;
    CHECK_THAT(exported,
               Contains(learnt == "sky" ? "with a sky of mean colour 0." : "with the background 0."));
    ubs_ok(folder, fmt::format("report {0} --out {0}.html", out));
    const std::string page = fmt::format("web {0}/model.ply --exact --out {0}-page.html", out);
    CHECK((ubs_ok(folder, page).err.find("mean colour of the sky") != std::string::npos) ==
          (learnt == "sky"));
  }
  ubs_ok(folder, "synth glossy --size 16 --views 3 --out data");
  check_error(folder, "train data --background sky --iterations 5 --out x", 3, "may be transparent");
}

TEST_CASE("the data of a run are read with the COLMAP model of the run") {
  const TempFolder folder;
  put_colmap_model(folder / "photos/sparse/0", 4);
  put_colmap_model(folder / "photos/sparse/1", 6);  // the largest, which is used by default
  fs::create_directories(folder / "photos/images");
  for (int i = 0; i < 6; ++i)
    save_png(folder / fmt::format("photos/images/p{}.png", i),
             Image8{16, 12, std::vector<std::uint8_t>(3 * 16 * 12, 90), {}});
  ubs_ok(
      folder,
      "train photos --out run --dim 3 --init-points 50 --cap-max 50 --iterations 5 --unit 1 --test-every 2 "
      "--colmap-model 0 --quiet");
  const auto views = [&](const std::string& arguments) {
    return json::parse(ubs_ok(folder, "eval run " + arguments + " --fps-views 0 --json").out)["views"].size();
  };
  CHECK(views("") == 2);  // every second one of the four views
  CHECK(views("photos") == 2);
  CHECK(views("photos --colmap-model 1") == 3);
}

TEST_CASE("cameras of photographs come from COLMAP") {
  const TempFolder folder;
  fs::create_directories(folder / "photos");
  for (int i = 0; i < 3; ++i)
    save_png(folder / fmt::format("photos/p{}.png", i),
             Image8{16, 12, std::vector<std::uint8_t>(3 * 16 * 12, 90), {}});
  check_error(folder, "train photos --out run", 3,
              "3 images but no cameras: find the cameras with COLMAP: ubs cameras photos");
  check_error(folder, "cameras photos --colmap ./colmap", 3, "apt-get install colmap");
  check_error(folder, "cameras nowhere", 3, "no such folder");
  put(folder / "colmap", kColmap);
  fs::permissions(folder / "colmap", fs::perms::owner_all);
  put_colmap_model(folder / "small", 2);
  put_colmap_model(folder / "large", 3);
  CHECK_THAT(ubs_ok(folder, "cameras photos --colmap ./colmap --dry-run").out,
             Contains("exhaustive_matcher --database_path") && Contains("mapper --database_path") &&
                 Contains("printf '%s\\n' p0.png p1.png p2.png >"));
  CHECK(test::file_count(folder / "photos") ==
        3);  // a dry run writes nothing, because the folder of the photographs may be read-only
  put(folder / "fail", "");
  check_error(folder, "cameras photos --quiet --colmap ./colmap", 3,
              "exhaustive_matcher ended with code 3: the matcher broke");
  // Daemons and job runners may ignore SIGCHLD. Without its default, ubs would not learn the exit code.
  const Result ignored = test::run_command(
      folder, fmt::format("env --ignore-signal=CHLD '{}' cameras photos --quiet --colmap ./colmap",
                          test::program_of("cameras")));
  CHECK(ignored.code == 3);
  CHECK_THAT(ignored.err, Contains("exhaustive_matcher ended with code 3: the matcher broke"));
  fs::remove(folder / "fail");
  // With another lens, the existing files of COLMAP are useless and must be deleted. A dry run only prints
  // the command that deletes them.
  const std::string work = get(folder / "photos/colmap/pictures.txt");
  CHECK_THAT(ubs_ok(folder, "cameras photos --colmap ./colmap --lens OPENCV --dry-run").out,
             Contains("rm -f ") && Contains("camera_model OPENCV"));
  CHECK(fs::exists(folder / "photos/colmap/database.db"));
  CHECK(get(folder / "photos/colmap/pictures.txt") == work);
  const Result found = ubs_ok(folder, "cameras photos --colmap ./colmap --order sequence");
  CHECK_THAT(found.out, Contains("3 of 3 images") && Contains("next     ubs train photos\n"));
  CHECK_THAT(get(folder / "calls.txt"),
             Contains("sequential_matcher") && Contains("--ImageReader.single_camera 1"));
  ubs_ok(folder, "train photos --out run --dim 3 --iterations 1 --init-points 20 --test-every 0 --quiet");
  check_error(folder, "cameras photos --colmap ./colmap", 2, "cameras are already there (");
}

TEST_CASE("cameras: existing cameras, videos, and photographs in unsupported formats are recognised") {
  const TempFolder folder;
  fs::create_directories(folder / "photos/images");
  for (int i = 0; i < 4; ++i)
    save_png(folder / fmt::format("photos/images/p{}.png", i),
             Image8{16, 12, std::vector<std::uint8_t>(3 * 16 * 12, 90), {}});
  const std::string commands = ubs_ok(folder, "cameras photos --dry-run").out;
  CHECK_THAT(commands, Contains("max_num_features 2048") && Contains("max_image_size 1600") &&
                           Contains("--ExhaustiveMatching.block_size 10"));
  put(folder / "photos/transforms.json", "{}");
  check_error(folder, "cameras photos --dry-run", 2,
              "cameras are already there (transforms.json): train with 'ubs train ");
  check_error(folder, "cameras photos/images --dry-run", 2, "cameras are already there (transforms.json)");
  for (const auto& [name, command] :
       {std::pair{"a.HEIC", "heif-convert"}, {"a.NEF", "darktable-cli"}, {"a.mov", "ffmpeg -i a.mov"}}) {
    for (const std::string where : {"raw", "raw/images"}) {
      fs::remove_all(folder / "raw");
      fs::create_directories(folder / where);
      put(folder / where / name, "0");
      for (const std::string ubs : {"cameras raw", "train raw --out run"})
        check_error(folder, ubs, 3, command);
    }
  }
  fs::remove_all(folder / "raw");
  for (const char* name : {"raw/a.heic", "raw/b.HEIC"}) put(folder / name, "0");
  check_error(folder, "cameras raw", 3, "for f in *.HEIC *.heic; do heif-convert");
}

TEST_CASE("a report shows the worst view and lists problems") {
  const TempFolder folder;
  put_scene(folder / "data", 24, 6, 6);
  ubs_ok(folder, "train data --out run --dim 3 --iterations 20 --init-points 60 --cap-max 60 --quiet");
  json metrics = json::parse(get(folder / "run/metrics.json"));
  json& second = metrics["test"]["views"][1];  // would not be shown if two evenly spaced views were chosen
  second["psnr"] = 1;
  put(folder / "run/metrics.json", metrics.dump());
  const std::string worst = second["name"].get<std::string>();
  const Result report = ubs_ok(folder, "report run --views 2");
  CHECK_THAT(report.out, Contains(fmt::format("the worst ('{}') among them", worst)));
  CHECK_THAT(get(folder / "run/report.html"), Contains(worst));
  CHECK_THAT(report.err, Contains("the maximum number of splats, --cap-max (60)") && !Contains("extents"));
  metrics["budget_seconds"] = 30;
  put(folder / "run/metrics.json", metrics.dump());
  CHECK_THAT(ubs_ok(folder, "report run --views 2 --overwrite").err, !Contains("--cap-max"));
  // Moves a splat far away. In real training, this can happen to a splat that only one camera sees.
  SplatModel model = load_splat_model(folder / "run/model.ply").model.single("test");
  model.row(0)[7] = 1e4f;
  write_splat_ply(folder / "far.ply", model);
  fs::rename(folder / "far.ply", folder / "run/model.ply");
  CHECK_THAT(ubs_ok(folder, "report run --out again.html").err,
             Contains("1 of 60 splats are more than 10 extents"));
}

TEST_CASE("devices --doctor prints a page about the devices that contains a verdict") {
  const TempFolder folder;
  const Result page = ubs_ok(folder, "devices --doctor --device cpu");
  for (const char* part :
       {"version ", "GiB free", "compiled kernels", "stages against float64: correct", "verdict "})
    CHECK_THAT(page.out, Contains(part));
  const Result broken = run_ubs(folder, "devices --doctor --json --device nosuchdevice");
  CHECK(broken.code == 4);
  put(folder / "file", "");
  const Result remark = test::run_command(
      folder,
      fmt::format("UBS_TUNING_DIR=$PWD/file/x '{}' devices --doctor --json --device cpu", UBS_EXECUTABLE));
  REQUIRE(remark.code == 0);
  const json doctor = json::parse(remark.out);
  CHECK(doctor["well"] == true);
  CHECK(doctor["devices"][0]["check"]["right"] == true);
  CHECK_THAT(doctor["problems"].dump(), Contains("results of ubs-lab tune"));
  const Result homeless = test::run_command(
      folder, fmt::format("TMPDIR=$PWD/none '{}' devices --doctor --json --device cpu", UBS_EXECUTABLE));
  INFO(homeless.err);
  CHECK_THAT(json::parse(homeless.out)["problems"].dump(), Contains("set TMPDIR to a writable folder"));
}

}  // namespace
}  // namespace ubs
