// SPDX-License-Identifier: Apache-2.0
// These functions read and write NumPy .npy files of format 1.0 with little-endian float32 or float64 values
// in C order. They are used to read data sets and reference data, and to exchange data with Python scripts.
// Other files, such as those with integers or in Fortran order, are refused with an error that states the
// reason.
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

namespace ubs {

struct NpyArray {
  std::vector<std::size_t> shape;  // empty for a scalar, which holds one value
  std::vector<float> values;
};

// Reads an array and rounds float64 values to float32. Throws Error(data) if a finite value exceeds the range
// of float32.
NpyArray read_npy(const std::filesystem::path& path);

// NpyArray64 and read_npy_double() keep the full precision of float64, in which poses_bounds.npy is stored.
struct NpyArray64 {
  std::vector<std::size_t> shape;
  std::vector<double> values;
};
NpyArray64 read_npy_double(const std::filesystem::path& path);
// Writes a float32 array. The number of values must be the product of the extents in `shape`.
void write_npy(const std::filesystem::path& path, std::span<const std::size_t> shape,
               std::span<const float> values);

}  // namespace ubs
