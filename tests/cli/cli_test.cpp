// SPDX-License-Identifier: Apache-2.0
// Tests the executable as users run it. Each test starts `ubs` as a process, and checks its exit code, its
// output and the files that it writes.
#include <catch2/catch.hpp>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "host/dataset/image.hpp"
#include "host/dataset/npy.hpp"
#include "host/formats/ply.hpp"
#include "host/scene/initialise.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::check_error;
using test::file_count;
using test::get;
using test::put;
using test::put_scene;
using test::quoted;
using test::Result;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

// Creates a small built-in scene in data/, with images of 32 x 32 pixels.
void synthesise(const TempFolder& folder, const std::string& scene = "glossy") {
  put_scene(folder / "data", 32, 8, 3, scene);
}

constexpr const char* kTiny =
    "--schedule published --iterations 200 --init-points 300 --cap-max 350 --log-every 50";

void train(const TempFolder& folder, const std::string& out, const std::string& more = "") {
  ubs_ok(folder, fmt::format("train --data data --out {} {} {}", out, kTiny, more));
}

// Puts data/ into the folder, and the model run/model.ply that train() creates from these data. The model is
// trained once for all tests.
void put_trained(const TempFolder& folder) {
  static const TempFolder made;
  if (!fs::exists(made / "run/model.ply")) {
    synthesise(made);
    train(made, "run");
  }
  fs::copy(made / "data", folder / "data", fs::copy_options::recursive);
  fs::create_directory(folder / "run");
  fs::copy(made / "run/model.ply", folder / "run/model.ply");
}

TEST_CASE("cli: --help-all and --version print their texts") {
  const TempFolder folder;
  for (const char* command : {"", "train", "render", "eval", "info", "synth", "devices"}) {
    const Result result = ubs_ok(folder, fmt::format("{} --help-all", command));
    CHECK(result.out.find(fmt::format("Usage: ubs{}{}", *command ? " " : "", command)) != std::string::npos);
    CHECK(result.out.find("Exit codes:\n  0 ") != std::string::npos);
  }
  const std::string help = ubs_ok(folder, "train --help-all").out;
  for (const char* option :
       {"--dim", "--iterations", "--cap-max", "--init-points", "--seed", "--device", "--spec", "--set",
        "--lambda-dssim", "--raster", "--query-grad", "--lr-cooldown NUMBER"})
    CHECK(help.find(option) != std::string::npos);
  CHECK(ubs_ok(folder, "--version").out.starts_with("ubs "));
}

TEST_CASE("cli: metrics compares images and folders") {
  const TempFolder folder;
  synthesise(folder);
  const auto measure = [&](const std::string& arguments) {
    return json::parse(ubs_ok(folder, "metrics --json " + arguments).out);
  };
  const json same = measure("data/test/r_000.png data/test/r_000.png --out m.json");
  CHECK(same["mean"]["psnr"].is_null());
  CHECK(same["mean"]["ssim"] == 1);
  CHECK(same["mean"]["ssim_valid"] == 1);
  CHECK(same == json::parse(get(folder / "m.json")));
  // The difference between two images of a single colour is known.
  for (const char* name : {"a", "b"}) fs::create_directories(folder / name);
  save_png(folder / "a/x.png", {32, 32, std::vector<std::uint8_t>(3 * 32 * 32, 100)});
  save_png(folder / "b/x.png", {32, 32, std::vector<std::uint8_t>(3 * 32 * 32, 110)});
  save_png(folder / "b/alone.png", {32, 32, std::vector<std::uint8_t>(3 * 32 * 32, 110)});
  const json known = measure("a b");
  CHECK(known["views"].size() == 1);
  CHECK(known["mean"]["psnr"].get<double>() == Approx(20 * std::log10(255.0 / 10)).epsilon(1e-5));
  const double m1 = 100 / 255.0, m2 = 110 / 255.0;
  CHECK(known["mean"]["ssim_valid"].get<double>() ==
        Approx((2 * m1 * m2 + 1e-4) / (m1 * m1 + m2 * m2 + 1e-4)).epsilon(1e-5));
  save_png(folder / "small.png", {8, 8, std::vector<std::uint8_t>(3 * 8 * 8, 100)});
  CHECK_FALSE(measure("small.png small.png")["mean"].contains("ssim_valid"));
  // Earlier versions skipped WebP files, and measured one of several files with this name at random.
  for (const char* name : {"twice/x.png", "twice/x.webp"}) put(folder / name, "");
  for (const char* folders : {"twice b", "b twice"})
    check_error(folder, fmt::format("metrics {}", folders), 3, "have the same name without extension");
  check_error(folder, "metrics small.png a/x.png", 3, "small.png has 8 x 8 pixels");
  check_error(folder, "metrics small.png none.png", 3, "none.png: no such file");
  check_error(folder, "metrics small.png a", 2, "two images or two folders");
  check_error(folder, "metrics a b --lpips alex", 2, "--lpips needs --lpips-weights");
  check_error(folder, "metrics a b --lpips-weights w", 2, "requires --lpips");
  check_error(folder, "metrics a b --lpips resnet --lpips-weights w", 2, "alex, squeeze or vgg");
  check_error(folder, "metrics a/x.png b/x.png --lpips alex --lpips-weights none", 3, "none");
  check_error(folder, "train --data data --out o --lpips vgg --lpips-weights .", 3, "lpips_vgg.safetensors");
  CHECK_FALSE(fs::exists(folder / "o/model.ply"));
}

TEST_CASE("cli: wrong usage gives a message of one line and exit code 2, or 3 for an unsuitable file") {
  const TempFolder folder;
  check_error(folder, "trian", 2, "did you mean 'train'?");
  check_error(folder, "train --out o", 2, "no data folder given");
  // Arguments that users may pass by mistake instead of a data folder.
  for (const char* name : {"scan.spz", "photo.JPG", "clip.mp4", "IMG_1.HEIC", "notes.xml"})
    std::ofstream(folder / name) << "x";
  check_error(folder, "train scan.spz", 3,
              "this is a model, not a data set: show it with 'ubs view scan.spz'");
  for (const std::string command : {"train ", "info "})
    check_error(folder, command + "photo.JPG", 3, "this is one image: pass a folder of images");
  check_error(folder, "info notes.xml", 3, "neither a data set nor a model: pass a data folder");
  for (const std::string command : {"train ", "cameras ", "info "}) {
    check_error(folder, command + "clip.mp4", 3,
                "this is a video: extract its frames ('mkdir photos; ffmpeg -i clip.mp4 -vf fps=2");
    check_error(folder, command + "IMG_1.HEIC", 3,
                "convert all photographs in its folder ('cd .; for f in *.HEIC; do heif-convert \"$f\" "
                "\"${f%.*}.jpg\"; done')");
  }
  check_error(folder, "train --data d --out o --itertions 3", 2, "did you mean --iterations?");
  // Options of other trainers
  for (const auto& [theirs, ours] : {std::pair{"-s d", "--data ("},
                                     {"-m o", "--out ("},
                                     {"-r 2", "--downscale ("},
                                     {"--resolution 2", "--downscale ("},
                                     {"--eval", "--test-every ("},
                                     {"--steps 9", "--iterations ("}})
    check_error(folder, fmt::format("train {}", theirs), 2, fmt::format("did you mean {}", ours));
  check_error(folder, "render -m model --out o", 2, "did you mean --model (");
  check_error(folder, "train --data d --out o --iterations 0", 2, "--iterations: iterations = '0'");
  check_error(folder, "train --data d --out o --lr-rgb nan", 2, "lr_rgb = 'nan'");
  check_error(folder, "train --data d --out o --set cap_mux=3", 2, "did you mean 'cap_max'?");
  check_error(folder, "train --data d --out o --set cap_max", 2, "key=value");
  check_error(folder, "train --data d --out o --near-plane 5 --far-plane 4", 2, "far_plane");
  check_error(folder, "render --model m --data d --out o --format jpg", 2, "jpg");
  check_error(folder, "eval --model m --data d --set iterations=3", 2, "unknown key 'iterations'");
  check_error(folder, "synth castle --out o", 2, "castle");
  CHECK(file_count(folder.path()) == 7);  // the five files above, stdout.txt and stderr.txt
}

// In earlier versions, each of these commands ran and ignored the option.
TEST_CASE("cli: an option is rejected if it has no effect with the other arguments or excludes one of them") {
  const TempFolder folder;
  for (const char* arguments : {"plan d --depth", "plan d --split train"})
    check_error(folder, arguments, 2, "requires --model");
  put(folder / "m.ply", "a model");
  check_error(folder, "plan d --model m.ply --iterations 5", 2, "--iterations only applies to training");
  check_error(folder, "plan d --model m.ply --set dim=3", 2, "unknown key 'dim'");
  check_error(folder, "info m.ply --allow-outside", 2, "--allow-outside only applies to data");
  check_error(folder, "render m.ply --out o --split test", 2, "--split requires a data folder");
  fs::remove(folder / "m.ply");
  check_error(folder, "train d --any-device", 2, "--any-device requires --resume");
  for (const char* command : {"train d", "eval m d", "metrics a b"})
    check_error(folder, fmt::format("{} --lpips-range unit", command), 2, "--lpips-range requires --lpips");
  for (const char* arguments :
       {"reduce m d --out o --bound 0.1 --max-loss-db 1", "reduce m d --out o --lossless --max-loss-db 1"})
    check_error(folder, arguments, 2, "--max-loss-db excludes");
  check_error(folder, "tune --size 48x40/500 m.ply", 2, "excludes");
  check_error(folder, "render m --video v.mp4 --format npy", 2, "--format requires --out");
  check_error(folder, "render m --out o --fps 10", 2, "--fps requires --video");
  check_error(folder, "web m --out o.ubsz --title T", 2, "only apply to HTML pages");
  check_error(folder, "bench --data d --list", 2, "--data requires --model");
  check_error(folder, "accuracy --out a --split train", 2, "--split requires --model");
  check_error(folder, "accuracy --out a m --splats 100", 2, "--splats only applies to built-in scenes");
  check_error(folder, "convert m.ply o.spz --degree 1 --distill 0", 2,
              "--degree requires that the Gaussians");
  check_error(folder, "convert m.ply o.spz --series 2 --time 1", 2, "--time excludes");
  CHECK(file_count(folder.path()) == 2);  // only stdout.txt and stderr.txt exist
}

// Commands such as tune, bench and reduce run for minutes. If they only noticed at the end that they cannot
// write the file, their results would be lost.
TEST_CASE("cli: a file that cannot be written is rejected before the work starts") {
  const TempFolder folder;
  put(folder / "g/full", "");
  for (const char* arguments : {"tune --quick --dry-run --json no/t.json", "bench --quick --json no/b.json"})
    check_error(folder, arguments, 3, ".json: cannot write: No such file or directory");
  check_error(folder, "tune --quick --dry-run --json g", 3, "this is a folder");
  CHECK_FALSE(fs::exists(folder / "no"));
  // A video may be in the folder of the images, which does not exist yet.
  write_splat_ply(folder / "m.ply", initialise_random(3, 20, 1));
  ubs_ok(folder, "render m.ply --path orbit --path-frames 2 --out p --video p/v.avi");
  CHECK(fs::exists(folder / "p/v.avi"));
}

// In earlier versions, a range without an upper limit printed the 309 digits of the largest double, and NaN
// was inside every range.
TEST_CASE("cli: a number that is out of range gives one short line, and NaN is out of every range") {
  const TempFolder folder;
  const auto refused = [&](const std::string& arguments, const std::string& message) {
    check_error(folder, arguments, 2, message);
    CHECK(get(folder / "stderr.txt").size() < 120);
  };
  for (const char* bad : {"-1", "nan", "inf", "many"})
    refused(fmt::format("eval m --fps-views {}", bad),
            fmt::format("--fps-views: expected a number of 0 or more, not {} (see 'ubs eval --help')", bad));
  for (const char* bad : {"0", "-0.5", "nan", "inf", "1e999"})
    refused(fmt::format("bench --max-time {}", bad),
            fmt::format("--max-time: expected a number above 0, not {}", bad));
  for (const char* bad : {"0", "100001", "2.5", "nan"})
    refused(fmt::format("synth glossy --out o --size {}", bad),
            fmt::format("--size: expected a whole number from 1 to 8192, not {}", bad));
  for (const char* bad : {"-90", "89.5", "nan"})
    refused(fmt::format("render m --out o --elevation {}", bad),
            fmt::format("--elevation: expected a number from -89 to 89, not {}", bad));
  // Unsigned numbers: earlier versions read -1 as 18446744073709551615.
  for (const char* arguments : {"synth glossy --out o --seed", "accuracy --out o --view"})
    refused(fmt::format("{} -1", arguments), ": expected a number of 0 or more, not -1");
  refused("plan d --ranks 2 --splats 0", "--splats: expected a number from 1 to 1000000000000, not 0");
  CHECK(file_count(folder.path()) == 2);
}

TEST_CASE("cli: unusable data gives a message of one line and exit code 3") {
  const TempFolder folder;
  check_error(folder, "train --data nowhere --out o", 3, "nowhere: no such data folder");
  check_error(folder, "info none.ply", 3, "none.ply: no such file");
  // The message must not be "no data folder given" if the model does not exist.
  for (const char* arguments :
       {"eval none.ply", "reduce none.ply --out o.ply", "compare --devices cpu none.ply",
        "gradients none.ply --view 0 --out o.ply", "plan --model none.ply"})
    check_error(folder, arguments, 3, "none.ply: no such file or folder");
  put(folder / "corrupt.ply",
      "ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty float x\nend_header\n");
  check_error(folder, "info corrupt.ply", 3, "corrupt.ply");
  put(folder / "text.ply", "hello\n");
  check_error(folder, "info text.ply", 3, "not a PLY file");
  put(folder / "bad.yaml", "iterations: 10\nitertions: 10\n");
  check_error(folder, "train --data d --out o --spec bad.yaml", 3, "bad.yaml:2:1: unknown key 'itertions'");
  put(folder / "wrong.yaml", "iterations: often\n");
  check_error(folder, "train --data d --out o --spec wrong.yaml", 3, "wrong.yaml:1:1: iterations = 'often'");
  check_error(folder, "train --data d --out o --spec absent.yaml", 3, "absent.yaml: no such file");
  CHECK_FALSE(fs::exists(folder / "o"));
}

TEST_CASE("cli: an unknown device gives exit code 4, and the message lists the devices") {
  const TempFolder folder;
  synthesise(folder);
  check_error(folder, "train --data data --out o --device nosuchdevice", 4,
              "'nosuchdevice' matches no device");
  CHECK_FALSE(fs::exists(folder / "o"));
  // All names are checked before the first device is measured. Otherwise, its results would be lost.
  check_error(folder, "bench --quick --run render.synthetic --device 0,nosuchdevice", 4,
              "'nosuchdevice' matches no device");
  const json devices = json::parse(ubs_ok(folder, "devices --json").out);
  REQUIRE(devices["devices"].size() >= 1);
  CHECK(devices["devices"][0]["name"].get<std::string>().size() > 0);
  CHECK(ubs_ok(folder, "devices --device 0").out.find("* 0") != std::string::npos);
}

TEST_CASE("cli: a missing training image is named before training") {
  const TempFolder folder;
  synthesise(folder);
  fs::remove(folder / "data/train/r_003.png");
  const Result said = ubs_ok(folder, "info data");
  CHECK((said.out + said.err).find("1 skipped: the image does not exist (./train/r_003)") !=
        std::string::npos);
  fs::remove_all(folder / "data/train");
  for (const char* command : {"train --data data --out o", "info data"})
    check_error(folder, command, 3,
                "none of the 8 images exists: for example, './train/r_000' does not exist");
}

TEST_CASE("cli: the files of train, eval, render and info agree with each other") {
  const TempFolder folder;
  synthesise(folder);
  train(folder, "run", "--unit 1");
  for (const char* file : {"model.ply", "metrics.json", "log.csv", "config.yaml"})
    CHECK(fs::exists(folder / "run" / file));

  const json metrics = json::parse(get(folder / "run/metrics.json"));
  CHECK(metrics["splats"] == 350);
  CHECK(metrics["iterations"] == 200);
  CHECK(metrics["interrupted"] == false);
  CHECK(metrics["peak_device_bytes"].get<double>() > 1e5);
  CHECK(metrics["settings"]["init_points"] == 300);
  CHECK(metrics["test"]["views"].size() == 3);
  // Black images would have a PSNR of 15.1 dB. The PSNR observed on PoCL is 17.52 dB.
  CHECK(metrics["test"]["mean"]["psnr"].get<double>() > 16.5);

  const std::string log = get(folder / "run/log.csv");
  CHECK(log.starts_with("iteration,seconds,loss,splats,test_psnr,test_ssim,sample_psnr,sample_views\n50,"));
  CHECK(std::count(log.begin(), log.end(), '\n') == 5);

  CHECK(file_count(folder / "run/renders") == 3);
  const Image8 pair = load_image(folder / "run/renders/r_000.png");
  CHECK(pair.width == 64);
  CHECK(pair.height == 32);
  const Image8 truth = load_image(folder / "data/test/r_000.png");
  for (int x = 0; x < 96; ++x)
    CHECK(pair.rgb[static_cast<std::size_t>(192 * 16 + x)] ==
          truth.rgb[static_cast<std::size_t>(96 * 16 + x)]);

  // `ubs eval` measures for the model file what training measured for the model in memory.
  const json eval =
      json::parse(ubs_ok(folder, "eval --model run/model.ply --data data --json --out e.json").out);
  CHECK(eval["mean"]["psnr"] == metrics["test"]["mean"]["psnr"]);
  CHECK(eval["mean"]["ssim"] == metrics["test"]["mean"]["ssim"]);
  CHECK(eval == json::parse(get(folder / "e.json")));
  CHECK(eval["mean"]["ssim_valid"].get<double>() < 1);
  CHECK(eval["frames"]["views"] == 3);
  CHECK(eval["frames"]["fps_wall"].get<double>() > 0);
  CHECK(eval["frames"]["fps_device"].get<double>() >= eval["frames"]["fps_wall"].get<double>() / 2);
  CHECK(eval["storage_bytes"] == fs::file_size(folder / "run/model.ply"));
  CHECK(metrics["storage_bytes"] == eval["storage_bytes"]);
  CHECK(eval["render_peak_device_bytes"].get<double>() < eval["peak_device_bytes"].get<double>());
  const json& minutes = metrics["minutes"];
  CHECK(minutes["total"].get<double>() == Approx(metrics["seconds"].get<double>() / 60));
  CHECK(minutes["sampled_views"].get<int>() >= 4);
  for (const char* stage :
       {"project_forward", "lists", "raster_forward", "raster_backward", "adam", "relocate"})
    CHECK(minutes["stages"][stage].get<double>() > 0);

  // PNG files contain the clamped and rounded values of the .npy files. The PSNR of the .npy files is that
  // of eval.
  ubs_ok(folder, "render --model run/model.ply --data data --out r --channels rgb,alpha,depth --views 0,2");
  CHECK(file_count(folder / "r") == 6);
  ubs_ok(folder, "render --model run/model.ply --data data --out n --format npy --channels alpha,rgb,depth");
  CHECK(file_count(folder / "n") == 9);
  const NpyArray rgb = read_npy(folder / "n/r_000.npy"), alpha = read_npy(folder / "n/r_000_alpha.npy");
  const NpyArray depth = read_npy(folder / "n/r_000_depth.npy");
  CHECK(rgb.shape == std::vector<std::size_t>{32, 32, 3});
  CHECK(alpha.shape == std::vector<std::size_t>{32, 32});
  CHECK(depth.shape == std::vector<std::size_t>{32, 32});
  CHECK(image_from_interleaved(rgb.values, 32, 32).rgb == load_image(folder / "r/r_000.png").rgb);
  double squared = 0;
  for (std::size_t i = 0; i < rgb.values.size(); ++i) {
    const double error = std::clamp(rgb.values[i], 0.0f, 1.0f) - truth.rgb[i] / 255.0;
    squared += error * error / static_cast<double>(rgb.values.size());
  }
  // The device computes sums in float32. The difference observed on PoCL is 8.1e-8 dB.
  CHECK(-10 * std::log10(squared) == Approx(eval["views"][0]["psnr_joint"].get<double>()).margin(1.6e-7));
  for (const float a : alpha.values) CHECK((a >= 0 && a <= 1));
  CHECK(*std::max_element(alpha.values.begin(), alpha.values.end()) > 0.5f);
  CHECK(*std::max_element(depth.values.begin(), depth.values.end()) > 1.0f);

  const json info = json::parse(ubs_ok(folder, "info run/model.ply --json").out);
  CHECK(info["dim"] == 6);
  CHECK(info["splats"] == 350);
  CHECK(info["bytes"] == fs::file_size(folder / "run/model.ply"));
  CHECK(info["groups"]["l_triangle"]["count"] == 15);
  CHECK(info["opacity_quantiles"]["100%"].get<double>() < 1);
}

TEST_CASE("cli: training, eval, render and gradients use the same variant of a model") {
  const TempFolder folder;
  synthesise(folder);
  train(folder, "run",
        "--dim 3 --kernel gaussian --colour sh2 --rot-mode quaternion --antialias on --unit 1");
  const json info = json::parse(ubs_ok(folder, "info run/model.ply --json").out);
  CHECK(info["variant"] == "rot_mode quaternion, kernel gaussian, colour sh2, antialias on");
  CHECK(info["parameters_per_splat"] == 3 + 27 + 1 + 3 + 4);
  CHECK(info["groups"]["sh_rest"]["count"] == 24);
  CHECK(info["noted_cameras"] == 8);
  // The model file alone determines how eval renders. The PSNR must be that which training measured.
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  const json eval = json::parse(ubs_ok(folder, "eval --model run/model.ply --data data --json").out);
  CHECK(eval["mean"]["psnr"] == metrics["test"]["mean"]["psnr"]);
  CHECK(eval["variant"] == info["variant"]);
  ubs_ok(folder, "render --model run/model.ply --data data --out r --views 0");
  ubs_ok(folder, "gradients --model run/model.ply --data data --view 1 --out g.ply");
  CHECK(read_splat_ply(folder / "g.ply").variant == read_splat_ply(folder / "run/model.ply").variant);
  // config.yaml reproduces the run.
  ubs_ok(folder, "train --data data --out again --spec run/config.yaml");
  CHECK(get(folder / "again/model.ply") == get(folder / "run/model.ply"));
  check_error(folder, "train --data data --out no --rot-mode quaternion", 2,
              "rot_mode = quaternion needs dim = 3");
  check_error(folder, "train --data data --out no --kernel cubic", 2, "kernel");
}

TEST_CASE("cli: results of training do not depend on the unit of the data") {
  const TempFolder folder;
  synthesise(folder);
  fs::copy(folder / "data", folder / "tiny", fs::copy_options::recursive);
  constexpr double kFactor = 1e-4;
  for (const char* file : {"transforms_train.json", "transforms_test.json"}) {
    json poses = json::parse(get(folder / "tiny" / file));
    for (json& frame : poses["frames"])
      for (int row = 0; row < 3; ++row) {
        json& position = frame["transform_matrix"][row][3];
        position = kFactor * position.get<double>();
      }
    put(folder / "tiny" / file, poses.dump());
  }
  const auto trained = [&](const std::string& data, const std::string& out, const std::string& more = "") {
    ubs_ok(folder, fmt::format("train --data {} --out {} {} {}", data, out, kTiny, more));
    return json::parse(get(folder / out / "metrics.json"));
  };
  const json own = trained("data", "own"), tiny = trained("tiny", "tiny-run");
  const auto number = [](const json& value) { return value.get<double>(); };
  const double psnr = number(own["test"]["mean"]["psnr"]);
  CHECK(number(tiny["test"]["mean"]["psnr"]) == Approx(psnr).margin(0.02));
  CHECK(number(tiny["settings"]["unit"]) == Approx(kFactor * number(own["settings"]["unit"])));
  CHECK(number(tiny["extent"]) == Approx(kFactor * number(own["extent"])));
  CHECK(tiny["splats"] == own["splats"]);
  CHECK(own["settings"]["noise_lr"] == tiny["settings"]["noise_lr"]);
  const json as_it_is = trained("tiny", "as-it-is", "--unit 1");
  CHECK(number(as_it_is["test"]["mean"]["psnr"]) < psnr - 0.5);
  // The noise of positions has the same strength, relative to the scene, as in published scenes.
  CHECK(number(own["settings"]["noise_lr"]) == 1.6e7);
  CHECK(number(as_it_is["settings"]["noise_lr"]) == 1e6);
  // The written model is in the unit of the data, and training uses another unit. So the values in the file
  // are products that were rounded.
  for (const char* run : {"own", "tiny-run"}) {
    const json measured = json::parse(ubs_ok(folder, fmt::format("eval {} --json", run)).out);
    const json& then = run == std::string("own") ? own : tiny;
    CHECK(number(measured["mean"]["psnr"]) == Approx(number(then["test"]["mean"]["psnr"])).margin(1e-5));
  }
  check_error(folder, "train --data data --out no --cov-param skew_nd --unit 5", 2, "choose unit = 1");
}

TEST_CASE("cli: alpha_min and freeze are recorded, and eval uses the recorded alpha_min") {
  const TempFolder folder;
  synthesise(folder);
  train(folder, "run", "--alpha-min 0.05 --freeze rgb --unit 1");
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  CHECK(metrics["settings"]["alpha_min"] == 0.05);
  CHECK(metrics["settings"]["freeze"] == "rgb");
  const std::string eval = "eval --model run/model.ply --data data --json ";
  const json plain = json::parse(ubs_ok(folder, eval).out);
  const json own = json::parse(ubs_ok(folder, eval + "--spec run/config.yaml").out);
  const json whole = json::parse(ubs_ok(folder, eval + "--alpha-min 0").out);
  CHECK(whole["alpha_min"] == 0);
  CHECK(plain["alpha_min"] == 0.05);
  CHECK(whole["mean"]["psnr"] != plain["mean"]["psnr"]);
  CHECK(own["mean"]["psnr"] == plain["mean"]["psnr"]);
  CHECK(own["mean"]["psnr"] == metrics["test"]["mean"]["psnr"]);
  check_error(folder, "train --data data --out no --freeze colour", 2, "'colour' is not a parameter group");
  check_error(folder, eval + "--alpha-min 0.6", 2, "alpha_min");
}

TEST_CASE("cli: gradients agree with finite differences of the loss that the same command prints") {
  const TempFolder folder;
  put_trained(folder);
  const auto loss_of = [&](const std::string& model) {
    const std::string arguments =
        "gradients --model " + model + " --data data --view 1 --out g.ply --overwrite --json";
    return json::parse(ubs_ok(folder, arguments).out)["loss"].get<double>();
  };
  loss_of("run/model.ply");
  const SplatModel gradient = read_splat_ply(folder / "g.ply");
  const SplatModel model = read_splat_ply(folder / "run/model.ply");
  REQUIRE(gradient.values.size() == model.values.size());

  // The loss is smooth along the colour gradient: (L(x + h g) - L(x - h g)) / 2h = |g|^2.
  double squared = 0;
  std::array<double, 2> loss{};
  const int rows[] = {model.layout().rgb, model.layout().rgb + 1, model.layout().rgb + 2};
  for (const int r : rows)
    for (const float g : gradient.row(r)) squared += static_cast<double>(g) * g;
  REQUIRE(squared > 0);
  const double h = 0.002 / squared;
  for (const int side : {0, 1}) {
    SplatModel moved = model;
    for (const int r : rows)
      for (std::size_t i = 0; i < model.count; ++i)
        moved.row(r)[i] += static_cast<float>((side ? h : -h) * gradient.row(r)[i]);
    write_splat_ply(folder / "moved.ply", moved);
    loss[static_cast<std::size_t>(side)] = loss_of("moved.ply");
  }
  // The device rounds the loss to float32. The relative error observed on PoCL is 0.0025.
  CHECK((loss[1] - loss[0]) / (2 * h) == Approx(squared).epsilon(0.005));
}

TEST_CASE("cli: gradients accepts a target file and rejects invalid arguments") {
  const TempFolder folder;
  put_trained(folder);
  const std::string base = "gradients --model run/model.ply --data data --out g.ply --overwrite --view ";
  ubs_ok(folder, "render --model run/model.ply --data data --out n --format npy --views 1");
  // If a render is compared with itself, the loss is 0.
  const json self = json::parse(ubs_ok(folder, base + "1 --target n/r_001.npy --json").out);
  CHECK(self["l1"] == 0);
  CHECK(self["loss"].get<double>() == Approx(0).margin(1e-6));
  const json query = json::parse(ubs_ok(folder, base + "1 --query-grad --json").out);
  const json plain = json::parse(ubs_ok(folder, base + "1 --json").out);
  CHECK(query["loss"] == plain["loss"]);
  CHECK(query["gradient_norms"]["xyz"] != plain["gradient_norms"]["xyz"]);
  CHECK(query["gradient_norms"]["rgb"] == plain["gradient_norms"]["rgb"]);
  check_error(folder, base + "7", 2, "--view 7");
  const std::size_t shape[] = {2, 2, 3};
  write_npy(folder / "small.npy", shape, std::vector<float>(12, 0.5f));
  check_error(folder, base + "1 --target small.npy", 3, "needs (32, 32, 3)");
}

TEST_CASE("cli: render and gradients need no images if the JSON file contains w and h") {
  const TempFolder folder;
  put_trained(folder);
  ubs_ok(folder, "render --model run/model.ply --data data --out before --format npy");
  fs::remove_all(folder / "data/test");
  ubs_ok(folder, "render --model run/model.ply --data data --out after --format npy");
  CHECK(get(folder / "before/r_001.npy") == get(folder / "after/r_001.npy"));
  ubs_ok(folder,
         "gradients --model run/model.ply --data data --view 1 --target before/r_001.npy --out g.ply");
  for (const char* command : {"gradients --model run/model.ply --data data --view 1 --out h.ply",
                              "eval --model run/model.ply --data data"}) {
    const Result result = run_ubs(folder, command);
    CHECK(result.code == 3);
    CHECK(result.err.find("for example, './test/r_000' does not exist") != std::string::npos);
    CHECK(result.err.find("error: data: split 'test' has no views; available: train\n") != std::string::npos);
  }
}

TEST_CASE("cli: the configuration of a run repeats it byte for byte") {
  const TempFolder folder;
  synthesise(folder);
  train(folder, "a", "--dim 6 --background 1,0.5,0 --noise-lr 1000 --seed 7");
  ubs_ok(folder, "train --data data --out b --spec a/config.yaml");
  CHECK(get(folder / "a/model.ply") == get(folder / "b/model.ply"));
  CHECK(get(folder / "a/config.yaml") == get(folder / "b/config.yaml"));
  // Later settings take precedence: --set overrides --spec, and an option overrides --set.
  ubs_ok(folder, "train --data data --out c --spec a/config.yaml --set seed=8 --set batch=2 --seed 9");
  const json settings = json::parse(get(folder / "c/metrics.json"))["settings"];
  CHECK(settings["seed"] == 9);
  CHECK(settings["batch"] == 2);
  CHECK(settings["background"] == json::array({1.0, 0.5, 0.0}));
  CHECK(get(folder / "a/model.ply") != get(folder / "c/model.ply"));
}

TEST_CASE("cli: a model is not overwritten by accident") {
  const TempFolder folder;
  synthesise(folder);
  train(folder, "run");
  const std::string before = get(folder / "run/model.ply");
  check_error(folder, "train --data data --out run --iterations 2 --init-points 10", 2, "--overwrite");
  CHECK(get(folder / "run/model.ply") == before);
  train(folder, "run", "--overwrite --seed 3");
  CHECK(get(folder / "run/model.ply") != before);
}

TEST_CASE("cli: dynamic scenes can be trained; static times or a single camera position give a warning") {
  const TempFolder folder;
  synthesise(folder, "orbit");
  for (const int dim : {4, 7}) {
    const std::string out = fmt::format("run{}", dim);
    const Result result =
        ubs_ok(folder, fmt::format("train --data data --out {} {} --dim {}", out, kTiny, dim));
    CHECK(result.err.find("warning") == std::string::npos);
    CHECK(json::parse(ubs_ok(folder, "info " + out + "/model.ply --json").out)["dim"] == dim);
  }
  fs::remove_all(folder / "data");
  synthesise(folder);
  const Result result = ubs_ok(folder, fmt::format("train --data data --out s {} --dim 7", kTiny));
  CHECK(result.err.find("warning: all training views have the same time") != std::string::npos);
  ubs_ok(folder, "synth glossy --size 16 --views 1 --out one");
  const Result one = ubs_ok(folder, "train one --out from-one --iterations 1 --init-points 50");
  CHECK(one.err.find("warning: all training cameras have the same position") != std::string::npos);
}

TEST_CASE("cli: train --json prints metrics.json, and train --quiet prints nothing") {
  const TempFolder folder;
  synthesise(folder);
  const Result loud = ubs_ok(folder, fmt::format("train --data data --out a {} --json", kTiny));
  CHECK(json::parse(loud.out) == json::parse(get(folder / "a/metrics.json")));
  const Result quiet = ubs_ok(folder, fmt::format("train --data data --out b {} --quiet", kTiny));
  CHECK(quiet.out.empty());
  CHECK(quiet.err.empty());
}

TEST_CASE("cli: an interrupted run saves its results so far and exits with 130") {
  const TempFolder folder;
  synthesise(folder);
  // The signal is sent to the training process when its log has a row. It is sent twice, because `timeout`
  // also does this.
  put(folder / "run.sh",
      fmt::format("'{}' train --data data --out run --iterations 1000000 --init-points 200 "
                  "--cap-max 200 --log-every 5 --quiet & pid=$!\n"
                  "for i in $(seq 6000); do [ \"$(wc -l <run/log.csv 2>/dev/null || echo 0)\" -gt 1 ] "
                  "&& break; sleep 0.1; done\nkill -TERM $pid; kill -TERM $pid; wait $pid; echo $? >code\n",
                  UBS_EXECUTABLE));
  REQUIRE(std::system(fmt::format("cd {} && sh run.sh 2>/dev/null", quoted(folder.path())).c_str()) == 0);
  CHECK(get(folder / "code") == "130\n");
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  CHECK(metrics["interrupted"] == true);
  CHECK(metrics["test"].is_null());
  CHECK(metrics["iterations"].get<int>() >= 5);
  CHECK(read_splat_ply(folder / "run/model.ply").count == 200);
}

TEST_CASE("tune stores a file, whose values `devices` lists, and a dry run stores nothing") {
  const TempFolder folder;
  setenv("UBS_TUNING", "on", 1);
  setenv("UBS_TUNING_DIR", (folder / "tuning").c_str(), 1);
  const Result dry = ubs_ok(folder, "tune --quick --dry-run --raster gpu --max-time 0.01");
  CHECK(dry.out.find("not stored") != std::string::npos);
  CHECK_FALSE(fs::exists(folder / "tuning"));
  // The time suffices for the first trials, whose kernels are already compiled. The report also lists trials
  // that were skipped.
  const Result tuned =
      ubs_ok(folder, "tune --quick --raster gpu --size 48x40/500 --json t.json --max-time 4");
  CHECK(tuned.out.find("UBS_BACKWARD_BATCH") != std::string::npos);
  const json report = json::parse(get(folder / "t.json"));
  CHECK(report["splats"] == 500);
  CHECK(report["width"] == 48);
  CHECK(report["trials"].size() > 10);
  CHECK(report["trials"][0]["constant"] == "UBS_PROJECT_GROUP");
  CHECK(report["trials"][0]["before_ms"] > 0);
  check_error(folder, "tune --quick --dry-run --model m.ply", 3, "m.ply: no such file");
  put(folder / "m.ply", "a model");
  check_error(folder, "tune --quick --dry-run --model m.ply", 2,
              "no data folder given, and m.ply is not inside a run folder");
  REQUIRE(file_count(folder / "tuning") == 1);

  const fs::path file = fs::directory_iterator(folder / "tuning")->path();
  json stored = json::parse(get(file));
  stored["values"] = {{"UBS_CHUNK", 32}};
  put(file, stored.dump());
  const json listed = json::parse(ubs_ok(folder, "devices --json").out);
  CHECK(listed["devices"][listed["chosen"].get<std::size_t>()]["tuning"] == json{{"UBS_CHUNK", 32}});
  const Result shown = ubs_ok(folder, "devices");
  CHECK(shown.out.find("UBS_CHUNK=32") != std::string::npos);
  CHECK(shown.err.empty());

  put(file, "{");
  const Result damaged = ubs_ok(folder, "devices");
  CHECK(damaged.err.starts_with("ubs: warning: "));
  CHECK(std::count(damaged.err.begin(), damaged.err.end(), '\n') == 1);
  setenv("UBS_TUNING", "off", 1);
  CHECK(ubs_ok(folder, "devices").err.empty());
  unsetenv("UBS_TUNING_DIR");
}

}  // namespace
}  // namespace ubs
