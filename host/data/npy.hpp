// SPDX-License-Identifier: Apache-2.0
// NumPy .npy files, format 1.0, of little-endian float32 or float64 in C order: the exchange format with
// Python scripts and golden data. Anything else (integers, Fortran order) is refused with its name.
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

// float64 is rounded; Error(data) for a finite value that float32 cannot hold.
NpyArray read_npy(const std::filesystem::path& path);

// As read_npy, with all digits: poses_bounds.npy is float64.
struct NpyArray64 {
  std::vector<std::size_t> shape;
  std::vector<double> values;
};
NpyArray64 read_npy_double(const std::filesystem::path& path);
void write_npy(const std::filesystem::path& path, std::span<const std::size_t> shape,
               std::span<const float> values);

}  // namespace ubs
