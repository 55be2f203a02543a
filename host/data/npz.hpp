// SPDX-License-Identifier: Apache-2.0
// NumPy archives (.npz): a ZIP file of .npy members, stored or deflated, as numpy.savez and
// numpy.savez_compressed write them. Read only. ZIP64, encryption and other methods are refused.
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace ubs {

// Elements of any of the types f4, f8, u1, i4, i8 (little-endian), converted to double: exact for all of
// them up to integers of 53 bits.
struct NpzArray {
  std::vector<std::size_t> shape;  // empty for a scalar
  std::vector<double> values;
};

// By the names of the arrays, without ".npy". Checksums and sizes are verified; Error(data) names the member.
std::map<std::string, NpzArray> read_npz(const std::filesystem::path& path);

}  // namespace ubs
