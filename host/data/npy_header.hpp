// SPDX-License-Identifier: Apache-2.0
// The head of a NumPy array (.npy, format 1.0), shared by the readers of single files and of archives.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace ubs {

struct NpyHeader {
  std::string type;                // NumPy's name: byte order, kind and bytes, such as "<f4"
  std::vector<std::size_t> shape;  // empty for a scalar
  std::size_t count = 1;           // elements
  std::size_t data = 0;            // position of the first element
};

// Reads and checks the head; `name` is used in messages. `item_bytes` tells the size of an element of a
// type, 0 for types that the caller does not take: these, Fortran order, and sizes that do not agree with
// the content are Error(data).
NpyHeader parse_npy_header(std::string_view content, const std::string& name,
                           std::size_t (*item_bytes)(std::string_view type));

}  // namespace ubs
