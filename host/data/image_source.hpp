// SPDX-License-Identifier: Apache-2.0
// These functions make image sources (ImageSource), which decode the image of a view on demand. The image is
// composited, undistorted and reduced, in this order. If a cache folder is given, it stores the results, so
// that the work is done only once.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <optional>

#include "host/data/undistort.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

struct FileImage {
  std::filesystem::path path, mask;  // mask may be empty
  std::array<double, 3> background{0, 0, 0};
  std::optional<Undistortion> undistortion;  // its lens has the size of the file
  // Size of the delivered image. If it differs, Pillow's bicubic filter resizes the image.
  int width = 0, height = 0;
};

// Returns a source that reads an image file. Where the file does not cover the undistorted view, the mask
// excludes the pixels.
std::shared_ptr<const ImageSource> file_image_source(FileImage image,
                                                     const std::filesystem::path& cache_folder = {});

// Returns a source that delivers the images of `inner`. It reads them from the PNG `file` if that exists and
// has the given size; otherwise it writes the file.
std::shared_ptr<const ImageSource> cached_image_source(std::shared_ptr<const ImageSource> inner,
                                                       const std::filesystem::path& file, int width,
                                                       int height);

// Returns a name for a file of the cache folder: a hash of everything that determines its pixels.
std::string cache_name(const std::string& description);

// Returns "path|size|modification time", which changes when the file changes.
std::string file_identity(const std::filesystem::path& path);

}  // namespace ubs
