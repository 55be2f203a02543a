// SPDX-License-Identifier: Apache-2.0
// Tests the pixels of TIFF and EXR files of many kinds. The files are written with libtiff and OpenEXR, and
// the expected values are those that were written.
#include <ImathBox.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <tiffio.h>

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "host/dataset/image.hpp"
#include "host/dataset/image_info.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using Catch::Contains;
using test::message_of;
using test::TempFolder;

namespace {

constexpr int kWidth = 21, kHeight = 18;

// TiffKind describes how a TIFF file stores samples.
struct TiffKind {
  int bits = 8, samples = 3, photometric = PHOTOMETRIC_RGB, extra = -1;  // extra: kind of alpha, -1: no tag
  int planar = PLANARCONFIG_CONTIG, compression = COMPRESSION_LZW;
  bool tiled = false;
  int orientation = ORIENTATION_TOPLEFT;
  int format = SAMPLEFORMAT_UINT;
};

// Writes a file of kWidth x kHeight pixels. `value(x, y, c)` returns the number to store.
template <typename Value>
void put_tiff(const std::filesystem::path& path, const TiffKind& kind, const Value& value) {
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  REQUIRE(tiff != nullptr);
  const int block = kind.tiled ? 16 : kHeight, across = kind.tiled ? 16 : kWidth;
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, kWidth);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kHeight);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, kind.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, kind.samples);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, kind.format);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, kind.photometric);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, kind.planar);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, kind.compression);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, kind.orientation);
  if (kind.tiled) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, across);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, block);
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, block);
  }
  const auto extra = static_cast<std::uint16_t>(kind.extra);
  if (kind.extra >= 0) TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, &extra);
  if (kind.photometric == PHOTOMETRIC_PALETTE) {
    std::vector<std::uint16_t> maps[3];
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < 1 << kind.bits; ++i)
        maps[c].push_back(static_cast<std::uint16_t>(257 * ((40 * i + 70 * c) % 256)));
    TIFFSetField(tiff, TIFFTAG_COLORMAP, maps[0].data(), maps[1].data(), maps[2].data());
  }
  const bool apart = kind.planar == PLANARCONFIG_SEPARATE;
  const int per_pixel = apart ? 1 : kind.samples;
  const std::size_t row_bytes = (static_cast<std::size_t>(across * per_pixel * kind.bits) + 7) / 8;
  for (int plane = 0; plane < (apart ? kind.samples : 1); ++plane)
    for (int y0 = 0; y0 < kHeight; y0 += block)
      for (int x0 = 0; x0 < kWidth; x0 += across) {
        std::vector<std::uint8_t> bytes(row_bytes * static_cast<std::size_t>(block));
        for (int y = y0; y < std::min(y0 + block, kHeight); ++y)
          for (int x = x0; x < std::min(x0 + across, kWidth); ++x)
            for (int c = 0; c < per_pixel; ++c) {
              const int v = value(x, y, apart ? plane : c), index = (x - x0) * per_pixel + c;
              std::uint8_t* row = bytes.data() + row_bytes * static_cast<std::size_t>(y - y0);
              if (kind.bits == 32)
                reinterpret_cast<float*>(row)[index] = static_cast<float>(v);
              else if (kind.bits == 16)
                reinterpret_cast<std::uint16_t*>(row)[index] = static_cast<std::uint16_t>(v);
              else
                row[index * kind.bits / 8] = static_cast<std::uint8_t>(
                    row[index * kind.bits / 8] | v << (8 - kind.bits - index * kind.bits % 8));
            }
        const auto plane_id = static_cast<std::uint16_t>(plane);
        const auto x = static_cast<std::uint32_t>(x0), y = static_cast<std::uint32_t>(y0);
        const auto size = static_cast<tmsize_t>(bytes.size());
        REQUIRE((kind.tiled ? TIFFWriteEncodedTile(tiff, TIFFComputeTile(tiff, x, y, 0, plane_id),
                                                   bytes.data(), size)
                            : TIFFWriteEncodedStrip(tiff, TIFFComputeStrip(tiff, y, plane_id), bytes.data(),
                                                    size)) == size);
      }
  TIFFClose(tiff);
}

int pattern(int x, int y, int c) { return (37 * x + 11 * y + 90 * c) % 256; }

// Checks every sample. `value(x, y, c)` returns what is expected.
template <typename Value>
void check_pixels(const Image8& image, const Value& value, double margin = 0.5) {
  REQUIRE((image.width == kWidth && image.height == kHeight));
  double worst = 0;
  std::size_t i = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c)
        worst = std::max(worst, std::abs(static_cast<double>(value(x, y, c)) - image.rgb[i++]));
  CHECK(worst <= margin);
}

}  // namespace

TEST_CASE("image: TIFF files with alpha are composited once", "[image]") {
  const TempFolder folder;
  const std::array<double, 3> background{1, 0.5, 0};
  for (const int bits : {8, 16})
    for (const int extra : {EXTRASAMPLE_ASSOCALPHA, EXTRASAMPLE_UNASSALPHA, -1})
      for (const bool grey : {false, true})
        for (const bool apart : {false, true})
          for (const bool tiled : {false, true}) {
            INFO(bits << " " << extra << " " << grey << " " << apart << " " << tiled);
            const double full = bits == 8 ? 255 : 65535;
            const int colours = grey ? 1 : 3;
            const auto alpha = [](int x, int) { return x % 5 * 63.75 / 255; };
            const auto straight = [&](int x, int y, int c) { return pattern(x, y, grey ? 0 : c) / 255.0; };
            put_tiff(folder / "a.tif",
                     {.bits = bits,
                      .samples = colours + 1,
                      .photometric = grey ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB,
                      .extra = extra,
                      .planar = apart ? PLANARCONFIG_SEPARATE : PLANARCONFIG_CONTIG,
                      .tiled = tiled},
                     [&](int x, int y, int c) {
                       const double a = alpha(x, y);
                       const double v =
                           c == colours ? a : straight(x, y, c) * (extra == EXTRASAMPLE_ASSOCALPHA ? a : 1);
                       return static_cast<int>(std::lround(v * full));
                     });
            check_pixels(
                load_image(folder / "a.tif", background),
                [&](int x, int y, int c) {
                  const double a = alpha(x, y);
                  return 255 * (straight(x, y, c) * a + background[static_cast<std::size_t>(c)] * (1 - a));
                },
                1.3);  // the result is truncated, and the stored values are rounded
            CHECK_FALSE(image_file_info(folder / "a.tif").opaque);
          }
}

TEST_CASE("image: TIFF files of every kind without alpha have the pixels that were written", "[image]") {
  const TempFolder folder;
  const auto check = [&](const TiffKind& kind, const auto& stored, const auto& expected,
                         double margin = 0.5) {
    INFO(kind.bits << " bits, " << kind.samples << " samples, photometric " << kind.photometric << ", planar "
                   << kind.planar << ", compression " << kind.compression << ", tiled " << kind.tiled);
    put_tiff(folder / "a.tif", kind, stored);
    check_pixels(load_image(folder / "a.tif"), expected, margin);
    const ImageInfo info = image_file_info(folder / "a.tif");
    CHECK(info.opaque);
    CHECK(info.orientation == kind.orientation);
  };
  for (const int planar : {PLANARCONFIG_CONTIG, PLANARCONFIG_SEPARATE})
    for (const bool tiled : {false, true})
      for (const int orientation : {ORIENTATION_TOPLEFT, ORIENTATION_RIGHTTOP}) {
        check({.planar = planar, .tiled = tiled, .orientation = orientation}, pattern, pattern);
        check(
            {.bits = 16, .planar = planar, .compression = COMPRESSION_ADOBE_DEFLATE, .tiled = tiled},
            [](int x, int y, int c) { return 257 * pattern(x, y, c); }, pattern);
        check(
            {.samples = 4, .photometric = PHOTOMETRIC_SEPARATED, .planar = planar, .tiled = tiled}, pattern,
            [](int x, int y, int c) { return (255 - pattern(x, y, c)) * (255 - pattern(x, y, 3)) / 255.0; },
            0.51);
      }
  for (const int bits : {1, 2, 4, 8}) {
    const int top = (1 << bits) - 1;
    const auto small = [&](int x, int y, int) { return pattern(x, y, 0) & top; };
    check({.bits = bits, .samples = 1, .photometric = PHOTOMETRIC_MINISBLACK}, small,
          [&](int x, int y, int) { return small(x, y, 0) * 255.0 / top; });
    check({.bits = bits, .samples = 1, .photometric = PHOTOMETRIC_MINISWHITE}, small,
          [&](int x, int y, int) { return 255 - small(x, y, 0) * 255.0 / top; });
    check({.bits = bits, .samples = 1, .photometric = PHOTOMETRIC_PALETTE}, small,
          [&](int x, int y, int c) { return (40 * small(x, y, 0) + 70 * c) % 256; });
  }
}

TEST_CASE("image: TIFF files whose pixels have no defined colour are refused", "[image]") {
  const TempFolder folder;
  const auto refused = [&](const TiffKind& kind) {
    put_tiff(folder / "a.tif", kind, [](int, int, int) { return 1; });
    return message_of([&] { load_image(folder / "a.tif"); });
  };
  CHECK_THAT(refused({.bits = 32, .format = SAMPLEFORMAT_IEEEFP}),
             Contains("a.tif: ") && Contains("8- and 16-bit") && Contains("floating-point"));
  CHECK_THAT(refused({.samples = 6}), Contains("a.tif: 6 channels are not supported"));
  CHECK_THAT(refused({.photometric = PHOTOMETRIC_LOGLUV}), Contains("photometric interpretation 32845"));
}

namespace {

// Writes an EXR file with 32-bit floats. `value(x, y, c)` returns the samples of channel `names[c]`, for the
// coordinates of the file.
template <typename Value>
void put_exr(const std::filesystem::path& path, const Imath::Box2i& display, const Imath::Box2i& data,
             const std::vector<std::string>& names, const Value& value) {
  Imf::Header header(display, data);
  Imf::FrameBuffer buffer;
  const int width = data.max.x - data.min.x + 1, height = data.max.y - data.min.y + 1;
  std::vector<std::vector<float>> samples(names.size());
  for (std::size_t c = 0; c < names.size(); ++c) {
    header.channels().insert(names[c], Imf::Channel(Imf::FLOAT));
    for (int y = data.min.y; y <= data.max.y; ++y)
      for (int x = data.min.x; x <= data.max.x; ++x)
        samples[c].push_back(static_cast<float>(value(x, y, static_cast<int>(c))));
    buffer.insert(names[c], Imf::Slice::Make(Imf::FLOAT, samples[c].data(), data.min, width, height,
                                             sizeof(float), sizeof(float) * static_cast<std::size_t>(width)));
  }
  Imf::OutputFile file(path.c_str(), header);
  file.setFrameBuffer(buffer);
  file.writePixels(height);
}

Imath::Box2i box(int x0, int y0, int x1, int y1) { return {Imath::V2i(x0, y0), Imath::V2i(x1, y1)}; }
const Imath::Box2i kPicture = box(0, 0, kWidth - 1, kHeight - 1);

double to_linear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }
double linear_pattern(int x, int y, int c) { return to_linear(pattern(x + 100, y + 100, c) / 255.0); }
int shown_pattern(int x, int y, int c) { return pattern(x + 100, y + 100, c); }

}  // namespace

TEST_CASE("image: the display window of an EXR file is the picture", "[image]") {
  const TempFolder folder;
  // A larger window, one that covers a part, one that overlaps, and one with another origin.
  for (const Imath::Box2i& data :
       {kPicture, box(-8, -6, kWidth + 7, kHeight + 5), box(3, 4, 10, 9), box(-5, 6, 8, kHeight + 20)})
    for (const bool alpha : {false, true}) {
      INFO(data.min.x << " " << data.min.y << " " << data.max.x << " " << data.max.y << " " << alpha);
      std::vector<std::string> names{"R", "G", "B"};
      if (alpha) names.emplace_back("A");
      put_exr(folder / "a.exr", kPicture, data, names,
              [](int x, int y, int c) { return c == 3 ? 1.0 : linear_pattern(x, y, c); });
      check_pixels(load_image(folder / "a.exr", {1, 1, 1}), [&](int x, int y, int c) {
        return data.intersects(Imath::V2i(x, y)) ? shown_pattern(x, y, c) : alpha ? 255 : 0;
      });
      CHECK(image_file_info(folder / "a.exr").opaque == !alpha);
    }
  put_exr(folder / "a.exr", box(10, 20, 9 + kWidth, 19 + kHeight), box(0, 0, 60, 60), {"Y"}, linear_pattern);
  check_pixels(load_image(folder / "a.exr"),
               [](int x, int y, int) { return shown_pattern(x + 10, y + 20, 0); });
}

TEST_CASE("image: the picture of an EXR file with layers is found", "[image]") {
  const TempFolder folder;
  const auto load = [&](const std::vector<std::string>& names, int first, bool alpha) {
    INFO(names.front());
    // The channels that form the picture start at index `first`; their order in the file is that of their
    // names.
    put_exr(folder / "a.exr", kPicture, kPicture, names, [&](int x, int y, int c) {
      const int channel = c - first;
      return channel < 0 || channel > 3 ? 0.25
             : channel == 3             ? 0.5
                                        : linear_pattern(x, y, channel) * (alpha ? 0.5 : 1);
    });
    check_pixels(
        load_image(folder / "a.exr", {1, 1, 1}),
        [&](int x, int y, int c) {
          return alpha ? (shown_pattern(x, y, c) + 255) / 2.0 : shown_pattern(x, y, c);
        },
        1);
  };
  load({"ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"}, 0, false);
  load({"ViewLayer.Normal.R", "ViewLayer.Normal.G", "ViewLayer.Normal.B", "ViewLayer.Combined.R",
        "ViewLayer.Combined.G", "ViewLayer.Combined.B", "ViewLayer.Combined.A", "ViewLayer.Depth.Z"},
       3, true);
  load({"A.Combined.R", "A.Combined.G", "A.Combined.B", "Composite.Combined.R", "Composite.Combined.G",
        "Composite.Combined.B", "Composite.Combined.A"},
       3, true);
  load({"albedo.R", "albedo.G", "albedo.B", "R", "G", "B", "A", "Z"}, 3, true);
  load({"only.R", "only.G", "only.B"}, 0, false);
  const std::vector<std::string> unclear{"a.R", "a.G", "a.B", "b.R", "b.G", "b.B"};
  put_exr(folder / "a.exr", kPicture, kPicture, unclear, linear_pattern);
  CHECK_THAT(message_of([&] { load_image(folder / "a.exr"); }),
             Contains("a.exr: cannot tell which layer") && Contains("a, b"));
  put_exr(folder / "a.exr", kPicture, kPicture, {"Z"}, linear_pattern);
  CHECK_THAT(message_of([&] { load_image(folder / "a.exr"); }),
             Contains("a.exr: the EXR file has no layer with"));
}

TEST_CASE("image: a damaged EXR file, and a pixel that is not finite, are errors", "[image]") {
  const TempFolder folder;
  put_exr(folder / "a.exr", kPicture, kPicture, {"R", "G", "B"}, linear_pattern);
  const std::string bytes = test::get(folder / "a.exr");
  for (int cut = 1; cut < 20; ++cut) {
    test::put(folder / "b.exr", bytes.substr(0, bytes.size() * static_cast<std::size_t>(cut) / 20));
    CHECK_THAT(message_of([&] { load_image(folder / "b.exr"); }), Contains("b.exr: "));
  }
  put_exr(folder / "a.exr", kPicture, kPicture, {"R", "G", "B"}, [](int x, int y, int) {
    return x == 2 && y == 3 ? std::numeric_limits<double>::quiet_NaN() : 0.5;
  });
  CHECK_THAT(message_of([&] { load_image(folder / "a.exr"); }),
             Contains("a.exr: pixel (2, 3) is not finite"));
}
