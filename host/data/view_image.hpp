// SPDX-License-Identifier: Apache-2.0
// These functions join a view with its image file: size, undistortion, reduction, intrinsics (docs/data.md).
// They are used by all layouts whose cameras state a lens.
#pragma once

#include <filesystem>
#include <string>

#include "host/data/image.hpp"
#include "host/data/lens.hpp"
#include "host/data/load_dataset.hpp"

namespace ubs {

// Throws Error(data) if the image does not fit its camera, for example because it was rotated or cropped. The
// sizes fit if they are equal, or if width and height have the same scale within a pixel; in the second case
// a note reports it.
void check_image_size(ImageSize file, ImageSize camera, const std::string& where, LoadReport& report);

// Sets intrinsics, size and image source of `view`, whose camera has a pinhole lens. `lens` refers to the
// size that the data set states. Without a file the view keeps the stated size, gets no image, and the
// function returns false.
//
// The delivered size is that of the lens, reduced by options.read.downscale, but not larger than the file: a
// folder of reduced images is used unchanged, with the intrinsics rescaled.
bool attach_image(View& view, const Lens& lens, const std::filesystem::path& file,
                  const std::filesystem::path& mask, const DatasetOptions& options, LoadReport& report);

// Appends the views of an image of any lens: one view, or several for a wide image (undistort.hpp). Each of
// several views gets the name of `view` with the face added (NAME_front). Views in which the mask leaves no
// pixel are skipped. Returns the number of views.
std::size_t append_views(std::vector<View>& views, const View& view, const Lens& lens,
                         const std::filesystem::path& file, const std::filesystem::path& mask,
                         const DatasetOptions& options, LoadReport& report);

// Returns the name of a view, which becomes a file name: "cam1/0001.jpg" -> "cam1_0001".
std::string view_name(const std::filesystem::path& relative);

}  // namespace ubs
