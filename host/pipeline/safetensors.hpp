// SPDX-License-Identifier: Apache-2.0
// safetensors files (named tensors, as the Python package of that name writes them): 8 bytes with the length
// of a JSON header, the header, then the values. Only float32 is read, and a file is refused unless its
// tensors fill it exactly, without gaps or overlaps, and every value is finite.
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
  std::filesystem::path path;  // for messages
  std::map<std::string, Tensor> tensors;
  // Throws Error(data) naming the file when there is no such tensor.
  const Tensor& at(const std::string& name) const;
};

// Throws Error(data) with the file and the tensor for anything unexpected.
TensorFile read_safetensors(const std::filesystem::path& path);

}  // namespace ubs
