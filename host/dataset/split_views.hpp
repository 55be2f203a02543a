// SPDX-License-Identifier: Apache-2.0
// These functions divide the views of data that state no splits into training and test views.
#pragma once

#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/load_report.hpp"

namespace ubs {

// By convention, results on published data are measured on every 8th image.
inline constexpr int kTestEvery = 8;

// Sorts images by name and splits them. The first and then every `test_every`-th image is in the split test
// (method.md 4.5), the others are in the split train. If `test_every` is 0, all images are in the split
// train. The value kAutoInt means kTestEvery. All views of one image (View::part_of) are in the same split.
std::vector<Split> split_every(std::vector<View> views, int test_every);

// Splits the views like split_every(), unless `test_every` is kAutoInt and there are fewer than 24 images. In
// this case, there are as many test images as with kTestEvery, but they are the images that the other images
// surround best, and the report gets a note. split_every() would make the first image a test image, and this
// image is often at the end of the path of the camera. If `test_every` is kAutoInt and there are fewer than
// three images, there is no test split.
std::vector<Split> split_views(std::vector<View> views, int test_every, LoadReport& report);

}  // namespace ubs
