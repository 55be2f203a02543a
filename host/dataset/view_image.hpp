// SPDX-License-Identifier: Apache-2.0
// These functions combine a view with its image file. They determine the size of the view, its intrinsics,
// and how the image is undistorted and reduced (docs/data.md). The loaders of data folders use them.
#pragma once

#include <filesystem>
#include <string>

#include "host/dataset/image.hpp"
#include "host/dataset/lens.hpp"
#include "host/dataset/load_dataset.hpp"

namespace ubs {

// Throws Error(data) if the size of an image file does not fit its camera, for example because the image was
// rotated or cropped. The sizes fit if they are equal. They also fit if width and height differ by the same
// factor, apart from rounding to whole pixels; in this case the report gets a note.
void check_image_size(ImageSize file, ImageSize camera, const std::string& where, LoadReport& report);

// Sets the intrinsics, the size and the image source of `view`, whose camera has a pinhole lens. `lens` is
// the lens for an image of the size that the data set states. If the file does not exist, the view keeps the
// stated size and gets no image, and the function returns false.
//
// The size of the view is that of the lens, reduced by options.read.downscale, but not larger than the image
// in the file. So a folder of reduced images is used unchanged, and the intrinsics are rescaled.
bool attach_image(View& view, const Lens& lens, const std::filesystem::path& file,
                  const std::filesystem::path& mask, const DatasetOptions& options, LoadReport& report);

// Appends the views of an image with any lens. These are one view, or several views for a wide image
// (undistort.hpp). If there are several views, the name of the face is added to the name of `view`
// (NAME_front). Views in which the mask leaves no pixel are skipped. Returns the number of views.
std::size_t append_views(std::vector<View>& views, const View& view, const Lens& lens,
                         const std::filesystem::path& file, const std::filesystem::path& mask,
                         const DatasetOptions& options, LoadReport& report);

// Returns the name of the view of an image, which can be used in file names. For "cam1/0001.jpg" it is
// "cam1_0001".
std::string view_name(const std::filesystem::path& relative);

}  // namespace ubs
