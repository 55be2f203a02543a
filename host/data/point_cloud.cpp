// SPDX-License-Identifier: Apache-2.0
// See point_cloud.hpp.
#include "host/data/point_cloud.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/data/ply_header.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

void check_point(const std::array<double, 3>& position, std::size_t index, const std::string& where) {
  for (const double v : position)
    if (!(std::abs(v) <= kMaxMagnitude)) checked_input(v, fmt::format("{}: point {}", where, index));
}

WorldPoints read_world_points(const std::filesystem::path& path) {
  const std::string name = path.string();
  PlyHeader header;
  std::ifstream stream = open_ply(path, header, true);
  std::vector<const PlyProperty*> properties;
  for (const char* axis : {"x", "y", "z"}) {
    properties.push_back(header.find(axis));
    if (!properties.back()) fail(ErrorKind::data, "{}: property '{}' is missing", name, axis);
  }
  const bool coloured = header.find("red") && header.find("green") && header.find("blue");
  if (coloured)
    for (const char* channel : {"red", "green", "blue"}) {
      properties.push_back(header.find(channel));
      if (properties.back()->type != PlyType::uint8)
        fail(ErrorKind::data, "{}: property '{}' must be of type uchar", name, channel);
    }

  std::vector<double> table(properties.size() * header.count);
  std::vector<double*> rows;
  for (std::size_t r = 0; r < properties.size(); ++r) rows.push_back(table.data() + r * header.count);
  read_ply_rows(stream, header, properties, rows, name);

  WorldPoints cloud;
  cloud.positions.resize(header.count);
  cloud.colours.assign(header.count, {127, 127, 127});
  for (std::size_t i = 0; i < header.count; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      cloud.positions[i][k] = rows[k][i];
      if (coloured) cloud.colours[i][k] = static_cast<std::uint8_t>(std::clamp(rows[3 + k][i], 0.0, 255.0));
    }
    check_point(cloud.positions[i], i, name);
  }
  return cloud;
}

PointCloud subtract_offset(const WorldPoints& points, const std::array<double, 3>& offset) {
  PointCloud cloud{{}, points.colours};
  cloud.positions.resize(points.positions.size());
  for (std::size_t i = 0; i < cloud.positions.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      cloud.positions[i][k] = static_cast<float>(points.positions[i][k] - offset[k]);
  return cloud;
}

}  // namespace ubs
