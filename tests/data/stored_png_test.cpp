// SPDX-License-Identifier: Apache-2.0
// The PNG writer of builds without OpenCV, read back with OpenCV: both codecs in one program, one of them
// renamed.
#define decode_image decode_image_none
#define write_png write_png_stored
#include "host/data/image_codec_none.cpp"
#undef decode_image
#undef write_png

#include <catch2/catch.hpp>

#include "tests/support/temp_folder.hpp"

namespace ubs {

RawImage decode_image(const std::filesystem::path& path);  // of image_codec_opencv.cpp

TEST_CASE("stored PNG files hold what was written", "[image]") {
  const test::TempFolder folder;
  // The last size needs more than one deflate block of 65535 bytes.
  for (const auto& [width, height] : {std::pair{1, 1}, {5, 3}, {211, 307}})
    for (const auto& [channels, wide] :
         {std::pair{1, false}, {3, false}, {4, false}, {1, true}, {3, true}, {4, true}}) {
      INFO(width << "x" << height << ", " << channels << " channels" << (wide ? ", 16 bits" : ""));
      RawImage image{width, height, channels, wide, {}};
      for (int i = 0; i < width * height * channels * (wide ? 2 : 1); ++i)
        image.bytes.push_back(static_cast<std::uint8_t>(i * 31 + i / 7));
      write_png_stored(folder / "image.png", image);
      const RawImage back = decode_image(folder / "image.png");
      CHECK(back.width == width);
      CHECK(back.height == height);
      CHECK(back.channels == channels);
      CHECK(back.wide == wide);
      CHECK(back.bytes == image.bytes);
    }
}

TEST_CASE("without an image library reading an image says what to do", "[image]") {
  CHECK(test::message_of([] { decode_image_none("view.png"); }).find("ubs pack") != std::string::npos);
}

}  // namespace ubs
