// SPDX-License-Identifier: Apache-2.0
// These functions make image sources (ImageSource), which decode the image of a view on demand. The image is
// first composited on the background, then undistorted and then reduced. If a cache folder is passed, the
// results for undistorted images without a mask are stored in it, so that this work is done only once for
// them.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <optional>

#include "host/dataset/undistort.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

struct FileImage {
  std::filesystem::path path, mask;  // mask may be empty
  std::array<double, 3> background{0, 0, 0};
  // Undistortion of the image in the file. undistortion->lens must have the size of this image.
  std::optional<Undistortion> undistortion;
  // Size of the image that load() returns. If the image in the file, after undistortion, has another size, it
  // is resized with the bicubic filter of Pillow (resample.hpp).
  int width = 0, height = 0;
};

// Returns a source that reads an image file. Pixels of the undistorted view that the file does not cover are
// masked.
std::shared_ptr<const ImageSource> file_image_source(FileImage image,
                                                     const std::filesystem::path& cache_folder = {});

// Returns a source that delivers the image of `inner`. If the PNG `file` exists and has the given size, the
// image is read from it; otherwise the image is loaded from `inner` and written to `file`.
std::shared_ptr<const ImageSource> cached_image_source(std::shared_ptr<const ImageSource> inner,
                                                       const std::filesystem::path& file, int width,
                                                       int height);

// Returns the name of a file in the cache folder. It is a hash of `description`, which must contain
// everything that determines the pixels of the image.
std::string cache_name(const std::string& description);

// Returns "path|size|modification time", which changes when the file changes.
std::string file_identity(const std::filesystem::path& path);

}  // namespace ubs
