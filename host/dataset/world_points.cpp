// SPDX-License-Identifier: Apache-2.0
// See world_points.hpp.
#include "host/dataset/world_points.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/formats/ply_header.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

void check_point(const std::array<double, 3>& position, std::size_t index, const std::string& where) {
  for (const double v : position)
    if (!(std::abs(v) <= kMaxMagnitude)) checked_input(v, fmt::format("{}: point {}", where, index));
}

bool add_point(WorldPoints& points, const std::array<double, 3>& position,
               const std::array<std::uint8_t, 3>& colour, std::size_t index, const std::string& where) {
  if (!std::ranges::all_of(position, [](double v) { return std::isfinite(v); })) {
    ++points.not_finite;
    return false;
  }
  check_point(position, index, where);
  points.positions.push_back(position);
  points.colours.push_back(colour);
  return true;
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
    for (const char* channel : {"red", "green", "blue"}) properties.push_back(header.find(channel));

  std::vector<double> table(properties.size() * header.count);
  std::vector<double*> rows;
  for (std::size_t r = 0; r < properties.size(); ++r) rows.push_back(table.data() + r * header.count);
  read_ply_rows(stream, header, properties, rows, name, NonFinite::keep);

  // Colours that are stored as bytes are from 0 to 255. Colours of another type are often from 0 to 1, so
  // they are multiplied by 255 if none of them exceeds 1.
  double largest = 0;
  for (std::size_t r = 3; r < rows.size(); ++r)
    for (std::size_t i = 0; i < header.count; ++i) {
      checked_input(rows[r][i], fmt::format("{}: point {}: '{}'", name, i, properties[r]->name));
      largest = std::max(largest, rows[r][i]);
    }
  const bool bytes = properties.back()->type == PlyType::uint8;
  const double scale = bytes || largest > 1 ? 1 : 255;
  if (largest > 255)
    fail(ErrorKind::data, "{}: colours must be from 0 to 255 or from 0 to 1, found {}", name, largest);

  WorldPoints cloud;
  std::vector<std::string> unused = unused_properties(header, properties);
  for (std::string& element : unused_elements(header, 1)) unused.push_back(std::move(element));
  cloud.unused = fmt::format("{}", fmt::join(unused, "; "));
  cloud.positions.reserve(header.count);
  cloud.colours.reserve(header.count);
  for (std::size_t i = 0; i < header.count; ++i) {
    std::array<std::uint8_t, 3> colour{127, 127, 127};
    for (std::size_t k = 0; k < 3 && coloured; ++k)
      colour[k] = static_cast<std::uint8_t>(std::clamp(scale * rows[3 + k][i] + 0.5, 0.0, 255.0));
    add_point(cloud, {rows[0][i], rows[1][i], rows[2][i]}, colour, i, name);
  }
  return cloud;
}

// Divides the bounding box of the points into 4 x 4 x 4 cells and computes two sums over the cells. The first
// is the sum of (number - expected number)^2 / expected number. For uniformly random points, it has a
// chi-squared distribution with 63 degrees of freedom, whose mean is 63 and whose standard deviation is 11.
// The second sum is computed for each colour channel. It is the sum of the squared deviations of the mean
// colours of the cells, divided by their variances. For random colours, it has the same distribution. Points
// on surfaces leave most cells empty, so their first sum is near the number of points. The points are treated
// as random if all four sums are below 150. About two random clouds in 10^8 exceed this bound.
bool is_random_filling(const WorldPoints& points) {
  constexpr std::size_t kFewest = 1000, kSide = 4, kCells = kSide * kSide * kSide;
  constexpr double kBound = 150;
  const auto count = static_cast<double>(points.positions.size());
  if (points.positions.size() < kFewest) return false;
  std::array<double, 3> low = points.positions[0], high = low, sum{}, squares{};
  for (std::size_t i = 0; i < points.positions.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], points.positions[i][k]);
      high[k] = std::max(high[k], points.positions[i][k]);
      const double colour = points.colours[i][k];
      sum[k] += colour;
      squares[k] += colour * colour;
    }
  std::array<double, kCells> inside{};
  std::array<std::array<double, 3>, kCells> colours{};
  for (std::size_t i = 0; i < points.positions.size(); ++i) {
    std::size_t cell = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double size = high[k] - low[k];
      if (!(size > 0)) return false;
      const double place = kSide * (points.positions[i][k] - low[k]) / size;
      cell = kSide * cell + std::min(kSide - 1, static_cast<std::size_t>(place));
    }
    inside[cell] += 1;
    for (std::size_t k = 0; k < 3; ++k) colours[cell][k] += points.colours[i][k];
  }
  const double expected = count / kCells;
  double of_numbers = 0;
  std::array<double, 3> of_colours{};
  for (std::size_t cell = 0; cell < kCells; ++cell) {
    of_numbers += (inside[cell] - expected) * (inside[cell] - expected) / expected;
    for (std::size_t k = 0; k < 3 && inside[cell] > 0; ++k) {
      const double mean = sum[k] / count, variance = squares[k] / count - mean * mean;
      const double difference = colours[cell][k] / inside[cell] - mean;
      if (variance > 0) of_colours[k] += inside[cell] * difference * difference / variance;
    }
  }
  return of_numbers < kBound && *std::ranges::max_element(of_colours) < kBound;
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
