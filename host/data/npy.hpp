// SPDX-License-Identifier: Apache-2.0
// These functions read and write NumPy .npy files, format 1.0, with little-endian float32 or float64 in C
// order. They serve to exchange data with Python scripts and reference data. Anything else (integers, Fortran
// order) is refused with an error that names it.
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

// Reads an array; float64 is rounded. Throws Error(data) for a finite value that float32 cannot hold.
NpyArray read_npy(const std::filesystem::path& path);

// Like NpyArray and read_npy, but with full precision, because poses_bounds.npy stores float64.
struct NpyArray64 {
  std::vector<std::size_t> shape;
  std::vector<double> values;
};
NpyArray64 read_npy_double(const std::filesystem::path& path);
void write_npy(const std::filesystem::path& path, std::span<const std::size_t> shape,
               std::span<const float> values);

}  // namespace ubs
