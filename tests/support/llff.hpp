// SPDX-License-Identifier: Apache-2.0
// Defines functions that write poses_bounds.npy, the file with the cameras of data sets in the LLFF layout,
// which N3V also uses.
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/temp_folder.hpp"

namespace ubs::test {

// Appends a camera to the rows of poses_bounds.npy. The camera is at (x, 0, 0), looks along the negative z
// axis of the world, and its y axis points up.
inline void add_row(std::vector<double>& rows, double x) {
  // The columns of the matrix are down (-y), right (x), back (z), the position, and height, width and focal
  // length.
  const double matrix[15] = {0, 1, 0, x, 96, -1, 0, 0, 0, 128, 0, 0, 1, 0, 100};
  rows.insert(rows.end(), matrix, matrix + 15);
  rows.insert(rows.end(), {2.0, 9.0});
}

// Writes poses_bounds.npy with the given values, which are rows of 17 numbers.
inline void put_poses(const std::filesystem::path& path, const std::vector<double>& values) {
  std::string header =
      fmt::format("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, 17), }}", values.size() / 17);
  header.append(117 - header.size(), ' ');
  header += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size());
  bytes += '\0';
  bytes += header;
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(double));
  put(path, bytes);
}

// Writes poses_bounds.npy with `count` cameras, whose positions are 1 apart, into a folder.
inline void put_rows(const std::filesystem::path& folder, int count) {
  std::vector<double> rows;
  for (int i = 0; i < count; ++i) add_row(rows, i);
  put_poses(folder / "poses_bounds.npy", rows);
}

}  // namespace ubs::test
