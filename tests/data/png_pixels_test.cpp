// SPDX-License-Identifier: Apache-2.0
// Tests that PNG files of every kind have the same pixels as with OpenCV, except for the transparency of grey
// files, and that problems are only reported as ubs::Error.
#include "host/dataset/png_pixels.hpp"

#include <png.h>

#include <opencv2/imgcodecs.hpp>
#include <random>

#include "host/base/crc32.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/image_info.hpp"
#include "tests/support/on_stderr.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

struct Kind {
  int colour, bits;
  bool transparent = false, interlaced = false;
  int gamma = 0;  // value of the gAMA chunk, in 1/100000; 0: the file has no such chunk
};

// Returns a PNG file with random pixels. Uses the low-level functions of libpng, because OpenCV can only
// write few kinds of PNG files.
std::string png_file(const Kind& kind) {
  constexpr png_uint_32 kWidth = 37, kHeight = 23;
  std::string file;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(
      png, &file,
      [](png_structp p, png_bytep bytes, std::size_t size) {
        static_cast<std::string*>(png_get_io_ptr(p))->append(reinterpret_cast<char*>(bytes), size);
      },
      nullptr);
  png_set_IHDR(png, info, kWidth, kHeight, kind.bits, kind.colour,
               kind.interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  std::mt19937 random(7);
  std::vector<png_color> palette;
  std::vector<png_byte> alphas;
  for (int i = 0; i < 1 << std::min(kind.bits, 8); ++i) {
    palette.push_back({png_byte(random()), png_byte(random()), png_byte(random())});
    alphas.push_back(png_byte(random()));
  }
  if (kind.colour == PNG_COLOR_TYPE_PALETTE)
    png_set_PLTE(png, info, palette.data(), static_cast<int>(palette.size()));
  png_color_16 clear{0, 1, 1, 1, 1};
  if (kind.transparent)
    png_set_tRNS(png, info, alphas.data(), static_cast<int>(std::min<std::size_t>(alphas.size(), 200)),
                 &clear);
  if (kind.gamma > 0) png_set_gAMA_fixed(png, info, kind.gamma);
  png_write_info(png, info);
  const std::size_t row_bytes = png_get_rowbytes(png, info);
  std::vector<std::vector<png_byte>> rows(kHeight, std::vector<png_byte>(row_bytes));
  std::vector<png_bytep> pointers;
  for (auto& row : rows) {
    for (png_byte& byte : row) byte = png_byte(random() % 3 == 0 ? 1 : random());
    pointers.push_back(row.data());
  }
  png_write_image(png, pointers.data());
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  return file;
}

cv::Mat decoded(const std::string& file) { return decode_png(std::as_bytes(std::span(file)), "f.png"); }

std::vector<Kind> kinds() {
  std::vector<Kind> all;
  for (const bool interlaced : {false, true}) {
    for (const int bits : {1, 2, 4, 8, 16}) all.push_back({PNG_COLOR_TYPE_GRAY, bits, false, interlaced});
    for (const bool transparent : {false, true}) {
      for (const int bits : {1, 2, 4, 8})
        all.push_back({PNG_COLOR_TYPE_PALETTE, bits, transparent, interlaced});
      for (const int bits : {8, 16}) all.push_back({PNG_COLOR_TYPE_RGB, bits, transparent, interlaced});
    }
    for (const int colour : {PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB_ALPHA})
      for (const int bits : {8, 16}) all.push_back({colour, bits, false, interlaced});
  }
  return all;
}

}  // namespace

TEST_CASE("png: every kind has the same pixels as with OpenCV") {
  for (const Kind& kind : kinds()) {
    INFO("colour type " << kind.colour << ", " << kind.bits << " bits, transparent " << kind.transparent
                        << ", interlaced " << kind.interlaced);
    const std::string file = png_file(kind);
    const cv::Mat pixels = decoded(file);
    const cv::Mat expected = cv::imdecode(std::vector<char>(file.begin(), file.end()), cv::IMREAD_UNCHANGED);
    REQUIRE(pixels.size() == expected.size());
    REQUIRE(pixels.type() == expected.type());
    CHECK(std::equal(pixels.datastart, pixels.dataend, expected.data));
  }
}

TEST_CASE("png: the stored values are not converted by gamma") {
  for (const Kind& kind : {Kind{PNG_COLOR_TYPE_RGB, 8}, Kind{PNG_COLOR_TYPE_PALETTE, 8},
                           Kind{PNG_COLOR_TYPE_RGB, 16}, Kind{PNG_COLOR_TYPE_RGB_ALPHA, 16}})
    for (const int gamma : {45455, 50000, 100000}) {
      INFO("colour type " << kind.colour << ", " << kind.bits << " bits, gamma " << gamma);
      const std::string plain = png_file(kind);
      const std::string tagged = png_file({kind.colour, kind.bits, false, false, gamma});
      REQUIRE(tagged.size() > plain.size());
      const cv::Mat expected = decoded(plain), pixels = decoded(tagged);
      REQUIRE(pixels.size() == expected.size());
      CHECK(std::equal(pixels.datastart, pixels.dataend, expected.datastart, expected.dataend));
    }
}

TEST_CASE("png: a grey value can be transparent") {
  const cv::Mat pixels = decoded(png_file({PNG_COLOR_TYPE_GRAY, 8, true}));
  REQUIRE(pixels.type() == CV_8UC4);
  int clear = 0;
  for (auto at = pixels.begin<cv::Vec4b>(); at != pixels.end<cv::Vec4b>(); ++at) {
    const cv::Vec4b& pixel = *at;
    CHECK(pixel[0] == pixel[1]);
    CHECK(pixel[0] == pixel[2]);
    CHECK(pixel[3] == (pixel[0] == 1 ? 0 : 255));
    clear += pixel[0] == 1;
  }
  CHECK(clear > 100);
}

TEST_CASE("png: a file that is decoded with alpha is not opaque") {
  const TempFolder folder;
  std::vector<Kind> all = kinds();
  all.push_back({PNG_COLOR_TYPE_GRAY, 8, true});
  for (const Kind& kind : all) {
    INFO("colour type " << kind.colour << ", " << kind.bits << " bits, transparent " << kind.transparent);
    const std::string file = png_file(kind);
    put(folder / "f.png", file);
    const int channels = decoded(file).channels();
    CHECK(image_file_info(folder / "f.png").opaque == (channels == 1 || channels == 3));
  }
}

TEST_CASE("png: damage gives one error, and no other output on stderr") {
  const TempFolder folder;
  const std::string file = png_file({PNG_COLOR_TYPE_PALETTE, 8, true});
  const std::size_t transparency = file.find("tRNS"), data = file.find("IDAT"), last = file.find("IEND");
  REQUIRE(data != std::string::npos);
  int refused = 0;
  const std::string printed = on_stderr([&] {
    for (const std::size_t at : {transparency + 9, data + 40, last + 5}) {
      std::string damaged = file;
      damaged[at] ^= 0x10;
      put(folder / "f.png", damaged);
      const std::string message = message_of([&] { load_image(folder / "f.png"); });
      refused += message.find("f.png: damaged or truncated PNG: ") != std::string::npos;
    }
  });
  CHECK(refused == 3);
  CHECK(printed == "");
}

TEST_CASE("png: more pixels than the file can contain are rejected before memory is allocated") {
  const auto sized = [](std::initializer_list<char> side, std::size_t more) {
    std::string file = png_file({PNG_COLOR_TYPE_GRAY, 1});
    for (const std::size_t at : {std::size_t{16}, std::size_t{20}}) file.replace(at, 4, side);
    const std::uint32_t crc = crc32(std::as_bytes(std::span(file).subspan(12, 17)));
    for (int i = 0; i < 4; ++i)
      file[29 + static_cast<std::size_t>(i)] = static_cast<char>(crc >> (24 - 8 * i));
    return file + std::string(more, 'x');
  };
  CHECK_THAT(message_of([&] {
               decoded(sized({0, 16, 0, 0}, 0));
             }),
             Contains("f.png: damaged or truncated PNG: 1048576 x 1048576 pixels cannot be stored in"));
  CHECK_THAT(message_of([&] {
               decoded(sized({0, 0, '\x81', 0}, 200'000));
             }),
             Contains("f.png: 33024 x 33024 pixels are too many: images can have at most"));
}
