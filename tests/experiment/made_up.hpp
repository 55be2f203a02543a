// SPDX-License-Identifier: Apache-2.0
// Test support: a data set and an experiment that need no data.
#pragma once

#include "tests/support/temp_folder.hpp"

namespace ubs::experiment {

inline constexpr const char* kSet =
    "name: toys\ndataset:\n  source: nowhere\n  licence: none\n  layout: blender\n  split: s\n  resolution: "
    "r\n"
    "  background: black\nwidth: 80\nsettings: {cap_max: 1000, init_points: 800, iterations: 400, downscale: "
    "2}\n"
    "scenes:\n  cube:\n  sphere: {title: the sphere, folders: [ball, kugel], settings: {cap_max: 2000}}\n";

}  // namespace ubs::experiment
