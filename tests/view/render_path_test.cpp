// SPDX-License-Identifier: Apache-2.0
// Tests the commands `ubs render --path` and `ubs render --lens`: images and videos along camera paths, and
// panoramas and fisheye images. There are models whose splats all have the same number of dimensions, and
// models with several. Also tests `ubs eval` with panoramas.
#include <catch2/catch.hpp>

#include "host/base/json.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/video.hpp"
#include "host/formats/ply.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "tests/support/images.hpp"
#include "tests/support/run_ubs.hpp"

using namespace ubs;
using Catch::Contains;
using test::TempFolder;

namespace {

using test::Result;

Result run(const TempFolder& folder, const std::string& arguments) {
  return test::run_ubs(folder, "render " + arguments);
}

std::string run_ok(const TempFolder& folder, const std::string& arguments) {
  return test::ubs_ok(folder, "render " + arguments).out;
}

SplatModel scene(int dim) { return oracle::regular_scene({.count = 200, .dim = dim, .seed = 11}).model; }

struct Video {
  std::vector<Image8> frames;
  explicit Video(const std::filesystem::path& path) {
    const auto file = open_video(path);
    for (int i = 0; i < video_frames(*file); ++i)
      frames.push_back(
          video_frame_source(file, i, video_size(*file).width, video_size(*file).height)->load());
  }
};

}  // namespace

TEST_CASE("render --path orbit: images and video of a dynamic model agree, and all frames differ") {
  const TempFolder folder;
  write_splat_ply(folder / "m.ply", scene(7));
  CHECK_THAT(
      run_ok(folder,
             "m.ply --path orbit --distance 4 --path-frames 6 --fps 12 --size 80x48 --video o.avi --out p"),
      Contains("6 views of 'path' in p") &&
          Contains("6 frames of 80x48, 0.50 s at 12 frames per second, MJPG, in o.avi"));
  const Video video(folder / "o.avi");
  REQUIRE(video.frames.size() == 6);
  CHECK(test::file_count(folder / "p") == 6);
  for (std::size_t i = 0; i < 6; ++i) {
    const Image8 picture = load_image(folder / fmt::format("p/frame_{:04}.png", i));
    CHECK(picture.width == 80);
    CHECK(picture.height == 48);
    // The observed error of Motion JPEG is 1.1. Views that are 60 degrees apart differ by at least 10.1.
    CHECK(test::image_difference(video.frames[i], picture) < 2.2);
    CHECK(test::image_difference(video.frames[i], video.frames[(i + 1) % 6]) > 5);
  }

  // With a single keyframe, the images only differ if the time changes.
  test::put(folder / "k.json",
            R"({"keyframes": [{"position": [0,-3,0.5], "look_at": [0,0,0], "up": [0,0,1], "time": 0.5}]})");
  const auto pictures = [&](const std::string& time) {
    run_ok(folder, "m.ply --path k.json --path-frames 3 --size 64x48 --fov 60 --out k --overwrite " + time);
    std::vector<std::string> bytes;
    for (int i = 0; i < 3; ++i) bytes.push_back(test::get(folder / fmt::format("k/frame_{:04}.png", i)));
    return bytes;
  };
  const auto kept = pictures(""), fixed = pictures("--time 0.5"), swept = pictures("--time 0:1");
  CHECK(kept[0] == kept[1]);
  CHECK(kept[1] == kept[2]);
  CHECK(fixed == kept);
  CHECK(swept[1] == kept[1]);
  CHECK(swept[0] != swept[1]);
  CHECK(swept[2] != swept[1]);
}

TEST_CASE("render --path: also renders mixed models, depth and alpha, and uses the image size of the data") {
  const TempFolder folder;
  write_mixed_ply(folder / "m.ply", MixedModel({scene(6), scene(3)}));
  for (const std::string channel : {"depth", "alpha"}) {
    run_ok(folder, "m.ply --path spiral --path-frames 3 --size 64x64 --video v.avi --overwrite --channels " +
                       channel);
    const Video video(folder / "v.avi");
    REQUIRE(video.frames.size() == 3);
    CHECK(test::image_difference(video.frames[0], video.frames[1]) > 1);
  }
  test::ubs_ok(folder, "synth glossy --out d --size 33 --views 6 --test-views 1 --supersampling 1");
  // Images of the data have 33 x 33 pixels. For videos, width and height are reduced to even numbers.
  CHECK_THAT(run_ok(folder, "m.ply --data d --path orbit --path-frames 2 --video o.avi"),
             Contains("2 frames of 32x32"));
  CHECK_THAT(run_ok(folder, "m.ply --data d --path orbit --path-frames 2 --out o"), Contains("2 views"));
  CHECK(load_image(folder / "o/frame_0001.png").width == 33);
}

TEST_CASE("render --lens: a panorama and a fisheye image agree with pinhole images in the same directions") {
  const TempFolder folder;
  write_splat_ply(folder / "m.ply", scene(6));
  test::put(folder / "k.json",
            R"({"keyframes": [{"position": [0,-1,0], "look_at": [0,0,0], "up": [0,0,1]}]})");
  const auto draw = [&](const std::string& options) {
    run_ok(folder, "m.ply --path k.json --path-frames 1 --out o --overwrite " + options);
    return load_image(folder / "o/frame_0000.png");
  };
  const Image8 pinhole = draw("--size 129x129 --fov 90");
  const auto error = [&](const Image8& wide, double pixels_per_radian, bool panorama) {
    double sum = 0;
    for (int y = 34; y < 95; ++y)  // up to 25 degrees from the axis
      for (int x = 34; x < 95; ++x) {
        const double u = (x - 64) / 64.5, v = (y - 64) / 64.5, r = std::hypot(u, v);
        const double angle = r > 0 ? std::atan(r) / r : 1;
        const double across = panorama ? std::atan(u) : angle * u;
        const double down = panorama ? std::atan2(v, std::hypot(u, 1)) : angle * v;
        const auto column = static_cast<std::size_t>(wide.width / 2 + std::floor(pixels_per_radian * across));
        const auto row = static_cast<std::size_t>(wide.height / 2 + std::floor(pixels_per_radian * down));
        for (std::size_t c = 0; c < 3; ++c)
          sum += std::abs(wide.rgb[3 * (row * static_cast<std::size_t>(wide.width) + column) + c] -
                          pinhole.rgb[3 * static_cast<std::size_t>(129 * y + x) + c]);
      }
    return sum / (3 * 61 * 61);
  };
  const Image8 panorama = draw("--size 512x256 --lens equirectangular");
  CHECK((panorama.width == 512 && panorama.height == 256));
  // The observed error is 0.87 of 255. The second call computes wrong directions, so its error must be large.
  CHECK(error(panorama, 512 / (2 * M_PI), true) < 1.7);
  CHECK(error(panorama, 400 / (2 * M_PI), true) > 8);
  const Image8 fisheye = draw("--size 256x256 --lens fisheye:200 --channels rgb,alpha,depth");
  CHECK(error(fisheye, 256 / (200 * M_PI / 180), false) < 2);  // observed 1.02
  CHECK((fisheye.rgb[0] == 0 && load_image(folder / "o/frame_0000_alpha.png").rgb[0] == 0));
  CHECK(std::filesystem::exists(folder / "o/frame_0000_depth.png"));
}

TEST_CASE("eval: a panorama is compared as a whole, except for its masked pixels") {
  const TempFolder folder;
  write_splat_ply(folder / "m.ply", scene(6));
  test::put(folder / "k.json",
            R"({"keyframes": [{"position": [0,-1,0], "look_at": [0,0,0], "up": [0,0,1]}]})");
  run_ok(folder,
         "m.ply --path k.json --path-frames 1 --size 256x128 --lens equirectangular --out data/images");
  std::filesystem::create_directories(folder / "data/sparse/0");
  test::put(folder / "data/sparse/0/cameras.txt", "1 EQUIRECTANGULAR 256 128 256 128\n");
  test::put(folder / "data/sparse/0/images.txt",
            "1 0.70710678118654752 0.70710678118654752 0 0 0 0 1 1 frame_0000.png\n\n");
  test::put(folder / "data/sparse/0/points3D.txt", "# none\n");
  // Returns the output of `ubs eval` for the folder, and checks that a packed file gives the same results.
  const auto measured = [&] {
    const std::string eval = "eval m.ply data --split train --test-every 0 --fps-views 0 --json";
    const std::string out = test::ubs_ok(folder, eval).out;
    test::ubs_ok(folder, "pack data --out data.ubsd --test-every 0 --overwrite");
    const std::string packed =
        test::ubs_ok(folder, "eval m.ply data.ubsd --split train --fps-views 0 --json").out;
    for (const char* part : {"views", "wide_images", "mean"})
      CHECK(parse_own_json(out, "eval").at(part) == parse_own_json(packed, "eval").at(part));
    return out;
  };
  const Json all = parse_own_json(measured(), "eval");
  REQUIRE(all.at("views").size() == 6);
  REQUIRE(all.at("wide_images").size() == 1);
  const Json& image = all.at("wide_images")[0];
  CHECK(image.at("name") == "frame_0000");
  for (const Json& view : all.at("views")) CHECK(view.at("part_of") == "frame_0000");
  // The compared image was rendered in the same way, so only the rounding to 8 bits causes a difference.
  CHECK(image.at("psnr").get<double>() > 55);
  CHECK(all.at("mean").at("psnr") == image.at("psnr"));
  CHECK(all.at("mean").at("ssim") == image.at("ssim"));

  Image8 painted = load_image(folder / "data/images/frame_0000.png");
  Image8 mask{256, 128, std::vector<std::uint8_t>(painted.rgb.size(), 255), {}};
  for (std::size_t i = 0; i < painted.rgb.size() / 2; ++i)
    painted.rgb[i] = static_cast<std::uint8_t>(255 - painted.rgb[i]), mask.rgb[i] = 0;
  save_png(folder / "data/images/frame_0000.png", painted);
  const double wrong = parse_own_json(measured(), "eval").at("mean").at("psnr").get<double>();
  CHECK(wrong < 20);
  std::filesystem::create_directories(folder / "data/masks");
  save_png(folder / "data/masks/frame_0000.png", mask);
  CHECK(parse_own_json(measured(), "eval").at("mean").at("psnr").get<double>() > 55);
}

TEST_CASE("render --path: error messages have one line, and no files are written") {
  const TempFolder folder;
  write_splat_ply(folder / "m.ply", scene(3));
  test::put(folder / "k.json", R"({"keyframes": [{"position": [0,0,1]}]})");
  const auto refused = [&](const std::string& arguments, int code, const std::string& reason) {
    const Result result = run(folder, arguments);
    INFO(arguments << "\n" << result.err);
    CHECK(result.code == code);
    CHECK_THAT(result.err, Contains(reason));
    CHECK(result.err.find('\n') == result.err.size() - 1);
    CHECK(test::file_count(folder.path()) == 4);  // the model, the keyframes, stdout.txt and stderr.txt
  };
  refused("m.ply --path orbit", 2, "--out DIR");
  refused("m.ply --path orbt --video v.avi", 2, "--path orbt");
  refused("m.ply --path k.json --video v.avi", 3, "keyframe 0: 'look_at' is missing");
  refused("m.ply --path none.json --video v.avi", 3, "none.json");
  refused("m.ply --path orbit --video v.gif", 2, "v.gif: the name of a video must end with one of");
  refused("m.ply --path orbit --video v.avi --size 63x64", 2, "even width");
  refused("m.ply --path orbit --video v.avi --size 64", 2, "--size 64");
  refused("m.ply --path orbit --video v.avi --time 0:1", 2, "--time 0:1: the model does not depend on time");
  refused("m.ply --path orbit --video v.avi --channels rgb,depth", 2, "one channel");
  refused("m.ply --path orbit --video v.avi --loops 0", 2, "--loops");
  refused("m.ply --path orbit --video v.avi --up 0,0", 2, "--up 0,0");
  refused("m.ply --data d --loops 2 --out o", 2, "--loops requires --path");
  refused("m.ply --lens wide --out o", 2, "--lens wide: expected equirectangular");
  refused("m.ply --path orbit --lens fisheye:400 --out o", 2, "--lens fisheye:400");
  refused("m.ply --path orbit --lens equirectangular --size 8x4 --out o", 2, "8x4 pixels are too few");
  // Earlier versions ignored these options.
  refused("m.ply --hold 1 --size 64x64 --out o", 2, "--size requires --path");
  refused("m.ply --hold 1 --fov 60 --out o", 2, "--fov requires --path");
  for (const char* option : {"--loops 2", "--centre 1,2,3", "--distance 4", "--elevation 5"})
    refused(fmt::format("m.ply --path k.json --out o {}", option), 2,
            "only applies to --path orbit and --path spiral");
}
