// SPDX-License-Identifier: Apache-2.0
// Split is the result of a loader. It contains named views. Each view has a camera and, if the image file
// exists, an 8-bit image that is already composited on the background. Images are kept in memory, or decoded
// on demand if they do not fit into memory.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs {

struct Image8 {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;     // (height, width, 3)
  std::vector<std::uint8_t> mask{};  // (height, width); 0: the pixel is ignored; empty: no pixel is ignored
  std::size_t bytes() const { return rgb.size() + mask.size(); }
};

// Converts (height, width, 3) to (3, height, width).
template <typename Values>
std::vector<typename Values::value_type> planar(const Values& interleaved) {
  const std::size_t pixels = interleaved.size() / 3;
  std::vector<typename Values::value_type> planes(interleaved.size());
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < pixels; ++i) planes[c * pixels + i] = interleaved[3 * i + c];
  return planes;
}

// ImageSource provides the image of a view. load() may be called by any thread and any number of times. It
// always returns the same pixels, in the size of the view's camera.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  virtual Image8 load() const = 0;
  // Returns the image if it stays in memory for the lifetime of this object, and null otherwise.
  virtual const Image8* held() const { return nullptr; }
};

class WideImage;  // host/scene/wide_image.hpp

struct View {
  std::string name;  // name of the frame, without folder and extension; a safe file name, unique in its split
  Camera camera;
  Image8 image;  // empty (width 0) if there is no image, or if `source` provides it
  std::shared_ptr<const ImageSource> source;
  bool masked = false;     // the image has a mask
  bool opaque = false;     // the image file has no alpha, so no background was composited
  bool resampled = false;  // the image was undistorted, so `camera` does not describe the pixels of `file`
  std::string part_of{};   // name of the wide image that the view shows a part of; otherwise empty
  std::shared_ptr<const WideImage> wide{};  // the wide image; null if it is not available
  std::array<double, 9> turn_in_wide{1, 0, 0, 0, 1, 0, 0, 0, 1};  // wide camera -> `camera`
  // Image file; empty if there is no image, or if it is in a video or packed file.
  std::filesystem::path file{};
  // Background of the image if it differs from the background in the settings. Only used for training.
  std::optional<std::array<float, 3>> background{};

  bool has_image() const { return source != nullptr || !image.rgb.empty(); }
  Image8 load_image() const { return source ? source->load() : image; }
  // Size of the decoded image, which need not be decoded yet.
  std::size_t image_bytes() const {
    return (masked ? 4 : 3) * static_cast<std::size_t>(camera.width) *
           static_cast<std::size_t>(camera.height);
  }
};

struct Split {
  std::string name;  // train, val, test
  std::vector<View> views;
};

// Returns the indices of the views of each image, in the order of the views. An image has several views if
// they show parts of the same wide image.
inline std::vector<std::vector<std::uint32_t>> views_by_image(const std::vector<View>& views) {
  std::vector<std::vector<std::uint32_t>> images;
  std::map<std::string, std::size_t> wide;
  for (std::uint32_t i = 0; i < views.size(); ++i) {
    const std::string& image = views[i].part_of;
    const auto [at, added] =
        image.empty() ? std::pair(wide.end(), true) : wide.try_emplace(image, images.size());
    if (added) images.emplace_back();
    (added ? images.back() : images[at->second]).push_back(i);
  }
  return images;
}

inline std::vector<Camera> cameras_of(const Split& split) {
  std::vector<Camera> cameras;
  for (const View& view : split.views) cameras.push_back(view.camera);
  return cameras;
}

}  // namespace ubs
