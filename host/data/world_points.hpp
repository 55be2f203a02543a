// SPDX-License-Identifier: Apache-2.0
// Coloured points from a PLY file, binary or ascii (x, y, z and, optionally, red, green, blue as uchar).
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>

#include "host/scene/point_cloud.hpp"

namespace ubs {

// Points in double precision, before the coordinates have been made local (dataset.hpp).
struct WorldPoints {
  std::vector<std::array<double, 3>> positions;
  std::vector<std::array<std::uint8_t, 3>> colours;  // as many as positions
};

// Error(data) that starts with `where` for a point that is not finite or beyond kMaxMagnitude (camera.hpp).
void check_point(const std::array<double, 3>& position, std::size_t index, const std::string& where);

// Points without colour get 127, the grey of the random initialisation (method.md 1.3).
WorldPoints read_world_points(const std::filesystem::path& path);

// Whether at least 1000 points fill their box evenly, as uniformly random numbers do, with colours that have
// nothing to do with the place. 3DGS code writes such points as points3d.ply into data folders that have
// none; they say nothing about the scene.
bool is_random_filling(const WorldPoints& points);

PointCloud subtract_offset(const WorldPoints& points, const std::array<double, 3>& offset);

}  // namespace ubs
