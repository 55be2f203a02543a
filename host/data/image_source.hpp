// SPDX-License-Identifier: Apache-2.0
// Images of views that are decoded on demand (ImageSource): composited, undistorted, reduced, in this
// order. A cache folder, where one is given, keeps the results so that the work is done once.
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
  int width = 0, height = 0;                 // delivered: Pillow's bicubic where it differs
};

// Where the undistortion does not fill its view, the mask excludes the pixels of which the file has nothing.
std::shared_ptr<const ImageSource> file_image_source(FileImage image,
                                                     const std::filesystem::path& cache_folder = {});

// Delivers what `inner` does, from `file` (a PNG) where it exists and has the size; else writes it.
std::shared_ptr<const ImageSource> cached_image_source(std::shared_ptr<const ImageSource> inner,
                                                       const std::filesystem::path& file, int width,
                                                       int height);

// Name for a file of the cache folder: a hash of everything that decides its pixels.
std::string cache_name(const std::string& description);

// "path|size|time of change": differs as soon as the file does.
std::string file_identity(const std::filesystem::path& path);

}  // namespace ubs
