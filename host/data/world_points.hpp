// SPDX-License-Identifier: Apache-2.0
// WorldPoints holds coloured points from a binary or ascii PLY file (x, y, z and, optionally, red, green,
// blue as uchar).
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>

#include "host/scene/point_cloud.hpp"

namespace ubs {

// Points in double precision, before an offset is subtracted from the coordinates (dataset.hpp).
struct WorldPoints {
  std::vector<std::array<double, 3>> positions;
  std::vector<std::array<std::uint8_t, 3>> colours;  // same number as positions
  std::string unused;  // names the columns and elements of the file that were not used; empty: none
};

// Throws Error(data) whose message starts with `where` if a point is not finite or beyond kMaxMagnitude
// (camera.hpp).
void check_point(const std::array<double, 3>& position, std::size_t index, const std::string& where);

// Reads a file. Points without colour get 127, the grey of the random initialisation (method.md 1.3).
WorldPoints read_world_points(const std::filesystem::path& path);

// Returns whether there are at least 1000 points that fill their box evenly, as uniformly random numbers do,
// with colours that do not depend on the position. 3DGS code writes such points as points3d.ply into data
// folders without points; they contain no information about the scene.
bool is_random_filling(const WorldPoints& points);

PointCloud subtract_offset(const WorldPoints& points, const std::array<double, 3>& offset);

}  // namespace ubs
