// SPDX-License-Identifier: Apache-2.0
// read_safetensors() reads safetensors files, which contain named tensors and are written by the Python
// package of that name. A file has 8 bytes with the length of a JSON header, the header, and then the values.
// Only float32 is supported. A file is rejected unless its tensors fill it exactly, without gaps or overlaps,
// and every value is finite.
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace ubs {

struct Tensor {
  std::vector<std::size_t> shape;
  std::vector<float> values;
};

struct TensorFile {
  std::filesystem::path path;  // used in messages
  std::map<std::string, Tensor> tensors;
  // Returns the tensor with this name. Throws Error(data) with the name of the file if there is none.
  const Tensor& at(const std::string& name) const;
};

// Reads a file. If its content is not as described above, throws Error(data) with the names of the file and
// of the tensor.
TensorFile read_safetensors(const std::filesystem::path& path);

}  // namespace ubs
