// SPDX-License-Identifier: Apache-2.0
// WorldPoints contains the coloured points of a data set. read_world_points() reads them from a binary or
// ASCII PLY file, whose properties are x, y, z and, optionally, red, green and blue.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>

#include "host/scene/point_cloud.hpp"

namespace ubs {

// The positions have double precision, because no offset has been subtracted from the coordinates yet
// (subtract_offset()).
struct WorldPoints {
  std::vector<std::array<double, 3>> positions;
  std::vector<std::array<std::uint8_t, 3>> colours;  // one per position
  std::string unused;  // names of the properties and elements that were not used; empty if there are none
  // Number of points that were left out because a coordinate is not finite.
  std::size_t not_finite = 0;
};

// Adds a point of a file. A point that is not finite is only counted; then the function returns false.
// Throws Error(data) with a message that starts with `where` if check_point() does.
bool add_point(WorldPoints& points, const std::array<double, 3>& position,
               const std::array<std::uint8_t, 3>& colour, std::size_t index, const std::string& where);

// Throws Error(data) with a message that starts with `where` if a coordinate is not finite, or if its
// absolute value exceeds kMaxMagnitude (camera.hpp).
void check_point(const std::array<double, 3>& position, std::size_t index, const std::string& where);

// Reads a PLY file. If the file has no colours, all channels of the points are set to 127, which is the grey
// of the random initialisation (method.md 1.3).
WorldPoints read_world_points(const std::filesystem::path& path);

// Returns whether the points are probably random numbers. This is the case if there are at least 1000 points,
// if they fill their bounding box evenly, and if their colours do not depend on the position. 3DGS code
// writes such points as points3d.ply into data folders without points; they contain no information about the
// scene.
bool is_random_filling(const WorldPoints& points);

// Returns the points relative to `offset`, in single precision.
PointCloud subtract_offset(const WorldPoints& points, const std::array<double, 3>& offset);

}  // namespace ubs
