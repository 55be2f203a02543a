// SPDX-License-Identifier: Apache-2.0
// NumPy .npy files, format 1.0, of little-endian float32 in C order: the exchange format with Python
// scripts and golden data. Anything else (float64, Fortran order) is refused with its name.
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

NpyArray read_npy(const std::filesystem::path& path);

// As read_npy for float32 or float64: poses_bounds.npy is float64.
struct NpyArray64 {
  std::vector<std::size_t> shape;
  std::vector<double> values;
};
NpyArray64 read_npy_double(const std::filesystem::path& path);
void write_npy(const std::filesystem::path& path, std::span<const std::size_t> shape,
               std::span<const float> values);

}  // namespace ubs
