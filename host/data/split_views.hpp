// SPDX-License-Identifier: Apache-2.0
// These functions divide the views of data that state no splits into training and test views.
#pragma once

#include <vector>

#include "host/data/load_report.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

// By convention, results on published data are measured on every 8th image.
inline constexpr int kTestEvery = 8;

// Sorts images by name and splits them: every n-th image is in the split test (method.md 4.5), the others are
// in the split train. All views of one image (View::part_of) are in the same split. kAutoInt stands for
// kTestEvery.
std::vector<Split> split_every(std::vector<View> views, int test_every);

// Does the same, unless `test_every` is kAutoInt and there are fewer than 24 images. Then the test images are
// as many as with kTestEvery, but they are those that the other images surround best, and a note says so:
// with every 8th image, the first one would be a test image, which often lies at the end of a walk.
std::vector<Split> split_views(std::vector<View> views, int test_every, LoadReport& report);

}  // namespace ubs
