// SPDX-License-Identifier: Apache-2.0
// Tests that truncated or damaged image files give errors, and never images with some wrong pixels.
// host/dataset/jpeg.hpp detects damage in JPEG files, and the libraries that decode the other formats detect
// damage in these. Intact JPEG files of every kind must have the same pixels as with OpenCV.
#include <turbojpeg.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "host/dataset/image.hpp"
#include "host/dataset/jpeg.hpp"
#include "host/dataset/load_dataset.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

cv::Mat photograph(int type) {
  cv::Mat image(61, 83, type);
  std::mt19937 random(1);
  const int channels = image.channels();
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x)
      for (int c = 0; c < channels; ++c) {
        const auto value = static_cast<unsigned>(2 * x + y * c + static_cast<int>(random() % 40)) & 255u;
        if (image.depth() == CV_16U)
          image.ptr<std::uint16_t>(y)[channels * x + c] = static_cast<std::uint16_t>(257 * value);
        else if (image.depth() == CV_32F)
          image.ptr<float>(y)[channels * x + c] = static_cast<float>(value) / 255.0f;
        else
          image.ptr<std::uint8_t>(y)[channels * x + c] = static_cast<std::uint8_t>(value);
      }
  return image;
}

std::string encoded(const char* extension, const cv::Mat& image, const std::vector<int>& options = {}) {
  std::vector<unsigned char> bytes;
  REQUIRE(cv::imencode(extension, image, bytes, options));
  return {bytes.begin(), bytes.end()};
}

// Returns a JPEG file of a kind that OpenCV does not write.
std::string turbo_jpeg(int width, int height, TJPF format, TJSAMP subsampling) {
  std::vector<unsigned char> pixels(sample_count(width, height, tjPixelSize[format]));
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = static_cast<unsigned char>(i * 2 + i / 96);
  const tjhandle encoder = tjInitCompress();
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  REQUIRE(tjCompress2(encoder, pixels.data(), width, 0, height, format, &bytes, &size, subsampling, 90, 0) ==
          0);
  const std::string file(reinterpret_cast<const char*>(bytes), size);
  tjFree(bytes);
  tjDestroy(encoder);
  return file;
}

struct Sample {
  const char* name;
  std::string file;
};

std::vector<Sample> jpegs() {
  const cv::Mat colour = photograph(CV_8UC3);
  cv::Mat grey;
  cv::cvtColor(colour, grey, cv::COLOR_BGR2GRAY);
  return {{"colour.jpg", encoded(".jpg", colour)},
          {"grey.jpg", encoded(".jpg", grey)},
          {"progressive.jpg", encoded(".jpg", colour, {cv::IMWRITE_JPEG_PROGRESSIVE, 1})},
          {"restarts.jpg", encoded(".jpg", colour, {cv::IMWRITE_JPEG_RST_INTERVAL, 2})},
          {"fine.jpg", encoded(".jpg", colour, {cv::IMWRITE_JPEG_QUALITY, 100})}};
}

std::vector<Sample> others() {
  const cv::Mat colour = photograph(CV_8UC3), deep = photograph(CV_16UC3), alpha = photograph(CV_8UC4);
  return {{"colour.png", encoded(".png", colour)},
          {"alpha.png", encoded(".png", alpha)},
          {"deep.png", encoded(".png", deep)},
          {"lossy.webp", encoded(".webp", colour, {cv::IMWRITE_WEBP_QUALITY, 80})},
          {"exact.webp", encoded(".webp", alpha, {cv::IMWRITE_WEBP_QUALITY, 101})},
          {"lzw.tiff", encoded(".tiff", colour)},
          {"plain.tiff", encoded(".tiff", colour, {cv::IMWRITE_TIFF_COMPRESSION, 1})},
          {"deflated.tiff", encoded(".tiff", deep, {cv::IMWRITE_TIFF_COMPRESSION, 8})},
          {"colour.bmp", encoded(".bmp", colour)}};
}

void check_pixels_of_opencv(const Image8& image, const std::string& file) {
  cv::Mat expected = cv::imdecode(std::vector<char>(file.begin(), file.end()), cv::IMREAD_COLOR);
  cv::cvtColor(expected, expected, cv::COLOR_BGR2RGB);
  REQUIRE(image.rgb.size() == 3 * expected.total());
  CHECK(std::equal(image.rgb.begin(), image.rgb.end(), expected.data));
}

std::string load_message(const std::filesystem::path& path, const std::string& bytes) {
  put(path, bytes);
  return message_of([&] { load_image(path); });
}

}  // namespace

TEST_CASE("damage: intact JPEG files have the same pixels as with OpenCV", "[damage]") {
  TempFolder folder;
  for (const Sample& sample : jpegs()) {
    INFO(sample.name);
    put(folder / sample.name, sample.file + "bytes after the end marker do not belong to the image");
    check_pixels_of_opencv(load_image(folder / sample.name), sample.file);
  }
}

TEST_CASE("damage: JPEG with four components is decoded if it is intact", "[damage]") {
  TempFolder folder;
  const std::string file = turbo_jpeg(24, 24, TJPF_CMYK, TJSAMP_444);
  put(folder / "cmyk.jpg", file);
  CHECK(load_image(folder / "cmyk.jpg").width == 24);
  CHECK_THAT(load_message(folder / "cmyk.jpg", file.substr(0, 2 * file.size() / 3)),
             Contains("truncated JPEG"));
}

// The test changes a file so that its four horizontally adjacent blocks of luma become four vertically
// adjacent blocks. TurboJPEG has no constant for this subsampling.
TEST_CASE("damage: JPEG with a rare subsampling is decoded", "[damage]") {
  TempFolder folder;
  std::string file = turbo_jpeg(32, 8, TJPF_RGB, TJSAMP_411);
  const std::size_t frame = file.find("\xff\xc0");
  REQUIRE(frame != std::string::npos);
  std::swap(file[frame + 6], file[frame + 8]);
  REQUIRE(file[frame + 11] == 0x41);
  file[frame + 11] = 0x14;
  put(folder / "rare.jpg", file);
  const Image8 image = load_image(folder / "rare.jpg");
  CHECK(image.width == 8);
  CHECK(image.height == 32);
  check_pixels_of_opencv(image, file);
  CHECK_THAT(load_message(folder / "rare.jpg", file.substr(0, file.size() - 6)), Contains("truncated JPEG"));
}

TEST_CASE("damage: a JPEG without an image, with 12 bits or of an unknown version is an error", "[damage]") {
  const std::string file = encoded(".jpg", photograph(CV_8UC3));
  const std::size_t frame = file.find("\xff\xc0");
  REQUIRE(frame != std::string::npos);
  const auto refused = [](const std::string& bytes) {
    return message_of([&] { decode_jpeg(std::as_bytes(std::span(bytes)), "f.jpg"); });
  };
  CHECK_THAT(refused(file.substr(0, frame)),
             Contains("f.jpg: damaged or truncated JPEG: it contains no image"));
  std::string deep = file;
  deep[frame + 4] = 12;
  CHECK_THAT(refused(deep), Contains("f.jpg: damaged or truncated JPEG: ") && Contains("12"));
  std::string version = file;
  version[file.find("JFIF") + 5] = 2;
  CHECK_THAT(refused(version), Contains("f.jpg: damaged or truncated JPEG: ") && Contains("JFIF"));
}

TEST_CASE("damage: an image that is truncated anywhere is an error", "[damage]") {
  TempFolder folder;
  std::vector<Sample> samples = jpegs();
  for (Sample& sample : others()) samples.push_back(std::move(sample));
  for (const Sample& sample : samples) {
    put(folder / sample.name, sample.file);
    load_image(folder / sample.name);
    constexpr std::size_t kCuts = 61;
    for (std::size_t cut = 0; cut < kCuts; ++cut) {
      const std::size_t length = cut * sample.file.size() / kCuts;
      INFO(sample.name << ": " << length << " of " << sample.file.size() << " bytes");
      CHECK_THAT(load_message(folder / sample.name, sample.file.substr(0, length)), Contains(sample.name));
    }
  }
}

// A decoder cannot detect every damage. A flipped bit often gives another valid code, and zeros in the last
// scans of a progressive file only change the lowest bits of coefficients. So this test replaces 200 bytes by
// zeros, and skips progressive files. TurboJPEG always detects this damage, which must be an error.
TEST_CASE("damage: a JPEG in which a range of bytes was replaced by zeros is an error", "[damage]") {
  TempFolder folder;
  for (const Sample& sample : jpegs()) {
    if (sample.name == std::string("progressive.jpg")) continue;
    std::size_t found = 0;
    constexpr std::size_t kHole = 200;
    const std::size_t first = sample.file.size() / 3;
    for (std::size_t at = first; at + kHole < sample.file.size(); at += 97) {
      std::string damaged = sample.file;
      damaged.replace(at, kHole, kHole, '\0');
      INFO(sample.name << ": zeros from byte " << at);
      CHECK_THAT(load_message(folder / sample.name, damaged), Contains("damaged or truncated JPEG"));
      ++found;
    }
    CHECK(found > 5);
  }
}

TEST_CASE(
    "damage: a JPEG that announces more pixels than it can contain is rejected before memory is allocated",
    "[damage]") {
  std::string file = encoded(".jpg", photograph(CV_8UC3), {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  const std::size_t frame = file.find("\xff\xc2");
  REQUIRE(frame != std::string::npos);
  for (const std::size_t at : {frame + 5, frame + 7}) file[at] = '\xff', file[at + 1] = '\xdc';
  CHECK_THAT(message_of([&] { decode_jpeg(std::as_bytes(std::span(file)), "huge.jpg"); }),
             Contains("huge.jpg: damaged or truncated JPEG: 65500 x 65500 pixels cannot be stored in"));
  for (const std::size_t at : {frame + 5, frame + 7}) file[at] = '\x81', file[at + 1] = '\0';
  file.resize(1'200'000);
  CHECK_THAT(message_of([&] { decode_jpeg(std::as_bytes(std::span(file)), "huge.jpg"); }),
             Contains("huge.jpg: 33024 x 33024 pixels are too many: images can have at most"));
}

TEST_CASE("damage: a data set with a truncated JPEG cannot be opened", "[damage]") {
  TempFolder folder;
  const std::string file = encoded(".jpg", photograph(CV_8UC3));
  put(folder / "train/a.jpg", file.substr(0, file.size() * 4 / 5));
  put(folder / "transforms_train.json",
      R"({"camera_angle_x": 0.9, "frames": [{"file_path": "train/a.jpg",
          "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]})");
  CHECK_THAT(message_of([&] { load_dataset(folder.path()); }), Contains("a.jpg: damaged or truncated JPEG"));
}
