// SPDX-License-Identifier: Apache-2.0
// Tests reading and writing images: compositing and truncation (docs/method.md, section 4.5), 16-bit files,
// resizing as in Pillow, PNG output, and errors.
#include "host/dataset/image.hpp"

#include <cmath>
#include <limits>
#include <opencv2/imgcodecs.hpp>

#include "host/base/philox.hpp"
#include "host/dataset/image_info.hpp"
#include "host/dataset/resample.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

// Returns an image with deterministic content and without symmetry. The Python code that computed the hashes
// below uses the same formula.
Image8 pattern(int width, int height) {
  Image8 image{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c)
        image.rgb.push_back(static_cast<std::uint8_t>((x * 37 + y * 91 + c * 53 + x * y * 7) % 256));
  return image;
}

std::uint32_t fnv1a(const std::vector<std::uint8_t>& bytes) {
  std::uint32_t hash = 2166136261u;
  for (const std::uint8_t b : bytes) hash = (hash ^ b) * 16777619u;
  return hash;
}

}  // namespace

TEST_CASE("image: every pair of value and alpha is composited and truncated", "[image]") {
  TempFolder folder;
  std::vector<std::uint8_t> rgba;
  for (int alpha = 0; alpha < 256; ++alpha)
    for (int value = 0; value < 256; ++value)
      for (const int v : {value, 255 - value, value / 2, alpha}) rgba.push_back(static_cast<std::uint8_t>(v));
  save_png_rgba(folder / "a.png", rgba, 256, 256);
  const std::array<double, 3> background{0.0, 1.0, 0.3};
  const Image8 image = load_image(folder / "a.png", background);
  REQUIRE(image.width == 256);
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < 65536; ++i)
    for (std::size_t c = 0; c < 3; ++c) {
      const double alpha = rgba[4 * i + 3] / 255.0;
      const double mixed = rgba[4 * i + c] / 255.0 * alpha + background[c] * (1.0 - alpha);
      wrong += image.rgb[3 * i + c] != static_cast<int>(std::floor(mixed * 255.0));
    }
  CHECK(wrong == 0);
  // Computed by hand: 200/255 * 128/255 * 255 = 100.39 -> 100. In front of white: 100.39 + 127 -> 227.
  save_png_rgba(folder / "b.png", std::vector<std::uint8_t>{200, 200, 200, 128}, 1, 1);
  CHECK(load_image(folder / "b.png").rgb == std::vector<std::uint8_t>{100, 100, 100});
  CHECK(load_image(folder / "b.png", {1, 1, 1}).rgb == std::vector<std::uint8_t>{227, 227, 227});
}

TEST_CASE("image: RGB and grey values are unchanged and in RGB order", "[image]") {
  TempFolder folder;
  const Image8 image = pattern(7, 5);
  save_png(folder / "a.png", image);
  CHECK(load_image(folder / "a.png", {1, 1, 1}).rgb == image.rgb);
  const cv::Mat first_pixel = cv::imread((folder / "a.png").string());
  CHECK(first_pixel.at<cv::Vec3b>(0, 0) == cv::Vec3b(106, 53, 0));  // B, G, R, as in OpenCV
  cv::imwrite((folder / "grey.png").string(), cv::Mat(1, 2, CV_8U, cv::Scalar(77)));
  CHECK(load_image(folder / "grey.png").rgb == std::vector<std::uint8_t>(6, 77));
  CHECK(file_count(folder.path()) == 2);
}

TEST_CASE("image: files with 16 bits are converted to 8 bits", "[image]") {
  TempFolder folder;
  const cv::Mat rgb(1, 1, CV_16UC3, cv::Scalar(65535, 128 * 257 + 128, 257 * 10 + 129));  // B, G, R
  cv::imwrite((folder / "rgb.png").string(), rgb);
  CHECK(load_image(folder / "rgb.png").rgb == std::vector<std::uint8_t>{11, 128, 255});
  const cv::Mat rgba(1, 1, CV_16UC4, cv::Scalar(65535, 65535, 32768, 32768));
  cv::imwrite((folder / "rgba.png").string(), rgba);
  CHECK(load_image(folder / "rgba.png").rgb == std::vector<std::uint8_t>{63, 127, 127});
}

TEST_CASE("image: resizing gives the same bytes as Pillow", "[image]") {
  // The hashes are FNV-1a of np.asarray(Image.fromarray(pattern).resize((W, H))), with Pillow 13.0.
  struct Case {
    int w, h, out_w, out_h;
    std::uint32_t hash;
  };
  for (const Case& c :
       {Case{13, 9, 6, 5, 0x176c6da3}, Case{16, 16, 8, 8, 0xcce99648}, Case{40, 30, 10, 8, 0x7078ad09},
        Case{5, 5, 11, 7, 0x4c757176}, Case{100, 50, 33, 17, 0x55c8ddc7}}) {
    const Image8 out = resize_bicubic(pattern(c.w, c.h), c.out_w, c.out_h);
    CAPTURE(c.w, c.h, c.out_w, c.out_h);
    CHECK(out.rgb.size() == static_cast<std::size_t>(3 * c.out_w * c.out_h));
    CHECK(fnv1a(out.rgb) == c.hash);
  }
}

TEST_CASE("image: reduced sizes are rounded to the nearest integer, but are at least 1", "[image]") {
  TempFolder folder;
  save_png(folder / "a.png", pattern(13, 9));
  CHECK(downscaled(13, 2) == 7);
  CHECK(downscaled(9, 2) == 5);
  CHECK(downscaled(1, 8) == 1);
  CHECK(image_file_size(folder / "a.png") == ImageSize{13, 9});
  CHECK_THAT(message_of([] { downscaled(4, 0); }, ErrorKind::usage), Contains("downscale factor 0"));
}

TEST_CASE("image: float output is clamped, rounded and checked", "[image]") {
  TempFolder folder;
  const std::vector<float> pixels{-1, 0.5f, 2, 0.1f, 0.2f, 0.3f};
  const std::vector<std::uint8_t> expected{0, 128, 255, 26, 51, 77};
  save_png_interleaved(folder / "i.png", pixels, 2, 1);
  CHECK(load_image(folder / "i.png").rgb == expected);
  const std::vector<float> bad{0, 0, std::numeric_limits<float>::quiet_NaN()};
  CHECK_THAT(message_of([&] { save_png_interleaved(folder / "n.png", bad, 1, 1); }, ErrorKind::numerical),
             Contains("sample 2 of the image is nan"));
  CHECK_FALSE(std::filesystem::exists(folder / "n.png"));
  CHECK_THAT(message_of([&] { save_png_interleaved(folder / "n.png", bad, 2, 1); }, ErrorKind::internal),
             Contains("2x1"));
}

TEST_CASE("image: errors contain the path", "[image]") {
  TempFolder folder;
  CHECK_THAT(message_of([&] { load_image(folder / "none.png"); }), Contains("none.png: no such file"));
  put(folder / "empty.png", "");
  CHECK_THAT(message_of([&] { load_image(folder / "empty.png"); }),
             Contains("empty.png: the image is an empty file"));
  put(folder / "text.png", "this is no image");
  CHECK_THAT(message_of([&] { load_image(folder / "text.png"); }), Contains("text.png: cannot decode"));
  CHECK_THAT(message_of([&] { image_file_size(folder / "text.png"); }), Contains("text.png: cannot decode"));
  // OpenCV would allocate 12 GB and 3 GB for these headers.
  for (const char* header : {"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32000 +X 32000\n",
                             "P6\n32000 32000\n255\n", "PF\n32000 32000\n-1\n"}) {
    put(folder / "huge.png", header + std::string(100, 'x'));
    CHECK_THAT(message_of([&] { load_image(folder / "huge.png"); }), Contains("unknown format"));
    CHECK_THAT(message_of([&] { image_file_size(folder / "huge.png"); }), Contains("unknown format"));
  }
  Image8 noise{64, 64, {}};
  const CounterRandom random(1, 0);
  for (std::uint32_t i = 0; i < 3 * 64 * 64; ++i)
    noise.rgb.push_back(static_cast<std::uint8_t>(random.bits(i, 0)));
  save_png(folder / "cut.png", noise);
  put(folder / "cut.png", get(folder / "cut.png").substr(0, 6000));
  CHECK_THAT(message_of([&] { load_image(folder / "cut.png"); }), Contains("cut.png: damaged or truncated"));
  cv::imwrite((folder / "float.tiff").string(), cv::Mat(1, 1, CV_32FC3, cv::Scalar(1, 1, 1)));
  CHECK_THAT(message_of([&] { load_image(folder / "float.tiff"); }), Contains("8- and 16-bit"));
}

TEST_CASE("image: the orientation of a TIFF file is reported, but not applied", "[image]") {
  const TempFolder folder;
  const auto put_tiff = [&](bool big, int orientation) {
    std::string bytes = big ? std::string("MM\0*", 4) : std::string("II*\0", 4);
    const auto add = [&](std::uint32_t value, int size) {
      for (int i = 0; i < size; ++i) bytes += static_cast<char>(value >> 8 * (big ? size - 1 - i : i) & 0xff);
    };
    const auto entry = [&](std::uint32_t tag, std::uint32_t value) {  // a number of two bytes
      add(tag, 2), add(3, 2), add(1, 4), add(value, 2), add(0, 2);
    };
    constexpr std::uint32_t kPixels = 8 + 2 + 10 * 12 + 4;
    add(8, 4), add(10, 2);
    entry(256, 3), entry(257, 2), entry(258, 8), entry(259, 1), entry(262, 1), entry(273, kPixels);
    entry(274, static_cast<std::uint32_t>(orientation)), entry(277, 1), entry(278, 2), entry(279, 6);
    add(0, 4);
    put(folder / "a.tif", bytes + std::string("\x0a\x14\x1e\x28\x32\x3c", 6));
  };
  for (const bool big : {false, true})
    for (int orientation = 1; orientation <= 8; ++orientation) {
      put_tiff(big, orientation);
      const ImageInfo info = image_file_info(folder / "a.tif");
      CHECK(info.size == ImageSize{3, 2});
      CHECK(info.orientation == orientation);
      const Image8 image = load_image(folder / "a.tif");
      REQUIRE(image.width == 3);
      for (std::size_t i = 0; i < 6; ++i) CHECK(image.rgb[3 * i] == 10 * (i + 1));
    }
}

TEST_CASE("image: files with three channels are opaque in every format", "[image]") {
  TempFolder folder;
  for (const char* name : {"a.tiff", "a.bmp"}) {
    cv::imwrite((folder / name).string(), cv::Mat(2, 3, CV_8UC3, cv::Scalar(1, 2, 3)));
    CHECK(image_file_info(folder / name).size == ImageSize{3, 2});
    CHECK(image_file_info(folder / name).opaque);
  }
  cv::imwrite((folder / "alpha.tiff").string(), cv::Mat(2, 3, CV_8UC4, cv::Scalar(1, 2, 3, 4)));
  CHECK_FALSE(image_file_info(folder / "alpha.tiff").opaque);
}
