// SPDX-License-Identifier: Apache-2.0
// What a loader delivers and everything downstream consumes: named views with cameras and,
// where the files exist, 8-bit images already composited on the background: in memory, or decoded on
// demand where they do not fit there.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs {

struct Image8 {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;     // (height, width, 3)
  std::vector<std::uint8_t> mask{};  // (height, width): 0 = the pixel does not count; empty: all do
};

// (height, width, 3) as (3, height, width).
template <typename Values>
std::vector<typename Values::value_type> planar(const Values& interleaved) {
  const std::size_t pixels = interleaved.size() / 3;
  std::vector<typename Values::value_type> planes(interleaved.size());
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < pixels; ++i) planes[c * pixels + i] = interleaved[3 * i + c];
  return planes;
}

// Delivers the image of a view. load() may be called by any thread, any number of times, and always
// gives the same pixels, of the size of the view's camera.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  virtual Image8 load() const = 0;
  // The same pixels where they lie in memory for as long as this object lives, else null.
  virtual const Image8* held() const { return nullptr; }
};

struct View {
  std::string name;  // of the frame, without folder and extension; a safe file name, unique in its split
  Camera camera;
  Image8 image;  // empty (width 0) when there is no image, or when `source` delivers it
  std::shared_ptr<const ImageSource> source;
  bool masked = false;           // the image comes with a mask
  bool opaque = false;           // its file is known to have no alpha: nothing of a background is in it
  std::string part_of{};         // of a view that shows a part of a wide image: the name of that image
  std::filesystem::path file{};  // of the image; empty if there is none, or it is in a video or packed file

  bool has_image() const { return source != nullptr || !image.rgb.empty(); }
  Image8 load_image() const { return source ? source->load() : image; }
};

struct Split {
  std::string name;  // train, val, test
  std::vector<View> views;
};

inline std::vector<Camera> cameras_of(const Split& split) {
  std::vector<Camera> cameras;
  for (const View& view : split.views) cameras.push_back(view.camera);
  return cameras;
}

}  // namespace ubs
