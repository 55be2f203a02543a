// SPDX-License-Identifier: Apache-2.0
// Joins a view with its image file: size, undistortion, reduction, intrinsics (docs/data.md). Common to
// the layouts whose cameras state a lens.
#pragma once

#include <filesystem>
#include <string>

#include "host/data/image.hpp"
#include "host/data/lens.hpp"
#include "host/data/load_dataset.hpp"

namespace ubs {

// Throws Error(data) unless the sizes of image and camera are equal, or width and height are scaled alike
// within a pixel, which is noted: a turned or cropped image does not belong to its camera.
void check_image_size(ImageSize file, ImageSize camera, const std::string& where, LoadReport& report);

// Sets intrinsics, size and image source of `view`, whose camera has a pinhole lens. `lens` refers to the
// size that the data set states. Without a file the view keeps the stated size and no image; false then.
//
// The delivered size is that of the lens, reduced by options.read.downscale, but never more than the file
// has: a folder of reduced images is used as it is, with the intrinsics rescaled.
bool attach_image(View& view, const Lens& lens, const std::filesystem::path& file,
                  const std::filesystem::path& mask, const DatasetOptions& options, LoadReport& report);

// Appends the views of an image of any lens: one, or those of a wide image (undistort.hpp), named after
// `view` and the face (NAME_front), without those in which the mask leaves no pixel. Returns their number.
std::size_t append_views(std::vector<View>& views, const View& view, const Lens& lens,
                         const std::filesystem::path& file, const std::filesystem::path& mask,
                         const DatasetOptions& options, LoadReport& report);

// Sorts images by name and deals them out: every n-th to test (method.md 4.5), the rest to train. All views
// of one image (View::part_of) go to the same split.
std::vector<Split> split_every(std::vector<View> views, int test_every);

// "cam1/0001.jpg" -> "cam1_0001": names become file names.
std::string view_name(const std::filesystem::path& relative);

}  // namespace ubs
