// SPDX-License-Identifier: Apache-2.0
// GltfFile is a glTF 2.0 file: its JSON, and the numbers of its accessors. It reads binary files (.glb) and
// text files (.gltf). The numbers may be in the binary file, in a data URI, or in a file in the same folder.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "host/base/json.hpp"

namespace ubs {

// Marks of the chunks of a binary file, and the type of float32 numbers.
inline constexpr std::uint32_t kGltfJsonChunk = 0x4e4f534a, kGltfBinChunk = 0x004e4942;
inline constexpr int kGltfFloat = 5126;

class GltfFile {
 public:
  // `bytes` is the content of the file, which must outlive this object. Messages start with `name`. Buffers
  // in other files are read relative to `folder`; if it is empty, they are refused.
  GltfFile(std::span<const std::byte> bytes, std::string name, std::filesystem::path path);

  const Json& json() const { return json_; }
  const std::string& name() const { return name_; }

  // Returns the number of elements of an accessor.
  std::size_t count(std::size_t accessor) const;
  // Returns the type of an accessor, such as VEC3.
  std::string type(std::size_t accessor) const;
  // Returns all numbers of an accessor with `width` numbers per element, which must have `count` elements.
  // Normalised integers become numbers from -1 or 0 to 1.
  std::vector<float> read(std::size_t accessor, std::size_t width, std::size_t count);
  // Loads the buffer of an accessor. loaded_bytes() returns the size of all buffers that were loaded.
  void load(std::size_t accessor) { view_of(accessor); }
  std::size_t loaded_bytes() const;

 private:
  struct View {
    std::span<const std::byte> bytes;
    std::size_t stride = 0;  // 0: not stated
  };
  View view_of(std::size_t accessor);
  std::span<const std::byte> buffer(std::size_t index);
  std::vector<std::byte> read_uri(const std::string& uri) const;

  std::string name_;
  std::filesystem::path path_;
  Json json_;
  std::span<const std::byte> bin_;  // the numbers in a binary file
  bool binary_ = false;
  std::map<std::size_t, std::vector<std::byte>> read_;  // contents of data URIs and other files
  std::map<std::size_t, std::span<const std::byte>> buffers_;
};

}  // namespace ubs
