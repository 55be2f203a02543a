// SPDX-License-Identifier: Apache-2.0
// put_safetensors() writes tensors as a safetensors file.
#pragma once

#include <cstdint>
#include <fstream>

#include "host/base/error.hpp"
#include "host/pipeline/safetensors.hpp"

namespace ubs::test {

inline void put_safetensors(const std::filesystem::path& path, const std::map<std::string, Tensor>& tensors) {
  std::string header;
  std::size_t at = 0;
  for (const auto& [name, tensor] : tensors) {
    const std::size_t end = at + tensor.values.size() * sizeof(float);
    header += fmt::format(R"({}"{}":{{"dtype":"F32","shape":[{}],"data_offsets":[{},{}]}})",
                          header.empty() ? "{" : ",", name, fmt::join(tensor.shape, ","), at, end);
    at = end;
  }
  header += "}";
  const std::uint64_t length = header.size();
  std::ofstream stream(path, std::ios::binary);
  stream.write(reinterpret_cast<const char*>(&length), sizeof length) << header;
  for (const auto& [name, tensor] : tensors)
    stream.write(reinterpret_cast<const char*>(tensor.values.data()),
                 static_cast<std::streamsize>(tensor.values.size() * sizeof(float)));
}

}  // namespace ubs::test
