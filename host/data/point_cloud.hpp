// SPDX-License-Identifier: Apache-2.0
// Coloured points from a binary PLY file (x, y, z and, optionally, red, green, blue as uchar).
#pragma once

#include <filesystem>
#include <optional>

#include "host/scene/point_cloud.hpp"

namespace ubs {

// Points without colour get 127, the grey of the random initialisation (method.md 1.3).
PointCloud read_point_cloud(const std::filesystem::path& path);

// The file points3d.ply of a data folder, or nothing when there is none.
std::optional<PointCloud> find_point_cloud(const std::filesystem::path& folder);

}  // namespace ubs
