// SPDX-License-Identifier: Apache-2.0
// This file writes poses_bounds.npy, the cameras of LLFF and N3V folders.
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/temp_folder.hpp"

namespace ubs::test {

// Appends the row of poses_bounds.npy of a camera at (x, 0, 0) that looks along -z of the world with y up.
inline void add_row(std::vector<double>& rows, double x) {
  const double matrix[15] = {0, 1,   0, x, 96, -1, 0,  0,
                             0, 128, 0, 0, 1,  0,  100};  // down = -y, right = x, back = z
  rows.insert(rows.end(), matrix, matrix + 15);
  rows.insert(rows.end(), {2.0, 9.0});
}

// Writes poses_bounds.npy from rows of 17 values.
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

// Writes poses_bounds.npy of this number of cameras into a folder.
inline void put_rows(const std::filesystem::path& folder, int count) {
  std::vector<double> rows;
  for (int i = 0; i < count; ++i) add_row(rows, i);
  put_poses(folder / "poses_bounds.npy", rows);
}

}  // namespace ubs::test
