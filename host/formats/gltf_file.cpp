// SPDX-License-Identifier: Apache-2.0
// See gltf_file.hpp. A binary file has a header, a chunk of JSON and a chunk of numbers.
#include "host/formats/gltf_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <utility>

#include "host/base/byte_reader.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

struct Component {
  std::size_t bytes = 4;
  double most = 1;  // value that represents 1 if the accessor is normalised
};
Component component_of(int type, const std::string& name) {
  switch (type) {
    case 5120:
      return {1, 127};
    case 5121:
      return {1, 255};
    case 5122:
      return {2, 32767};
    case 5123:
      return {2, 65535};
    case kGltfFloat:
      return {4, 1};
    default:
      fail(ErrorKind::data, "{}: numbers of type {} are not supported", name, type);
  }
}

float component_at(const std::byte* at, int type) {
  const auto number = [at]<typename T>(T value) {
    std::memcpy(&value, at, sizeof value);
    return static_cast<float>(value);
  };
  switch (type) {
    case 5120:
      return number(std::int8_t{});
    case 5121:
      return number(std::uint8_t{});
    case 5122:
      return number(std::int16_t{});
    case 5123:
      return number(std::uint16_t{});
    default:
      return number(0.0f);
  }
}

// Returns the value of a digit of base64 (standard or URL alphabet) or of a hexadecimal digit, or -1.
int base64_digit(char c) {
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  return c == '+' || c == '-' ? 62 : c == '/' || c == '_' ? 63 : -1;
}

std::vector<std::byte> decode_base64(std::string_view text, const std::string& name) {
  while (text.ends_with('=')) text.remove_suffix(1);
  std::vector<std::byte> out;
  out.reserve(text.size() / 4 * 3 + 2);
  std::uint32_t bits = 0;
  int count = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const int digit = base64_digit(text[i]);
    if (digit < 0) fail(ErrorKind::data, "{}: character {} of a data URI is not base64", name, i);
    bits = bits << 6 | static_cast<std::uint32_t>(digit);
    count += 6;
    if (count >= 8) out.push_back(static_cast<std::byte>(bits >> (count -= 8) & 255));
  }
  if (count == 6) fail(ErrorKind::data, "{}: a data URI ends too early", name);
  return out;
}

// Replaces %20 and similar parts of a URI by the characters that they stand for.
std::string decode_percent(std::string_view uri) {
  const auto digit = [](char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
  };
  std::string out;
  for (std::size_t i = 0; i < uri.size(); ++i) {
    const int high = uri[i] == '%' && i + 2 < uri.size() ? digit(uri[i + 1]) : -1;
    const int low = high >= 0 ? digit(uri[i + 2]) : -1;
    out += low >= 0 ? static_cast<char>(16 * high + low) : uri[i];
    if (low >= 0) i += 2;
  }
  return out;
}

}  // namespace

GltfFile::GltfFile(std::span<const std::byte> bytes, std::string name, std::filesystem::path path)
    : name_(std::move(name)), path_(std::move(path)) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  binary_ = text.starts_with("glTF");
  if (!binary_) {
    const std::size_t mark = text.starts_with("\xef\xbb\xbf") ? 3 : 0;
    json_ = parse_json(text.substr(mark), name_);
    limit_members(json_, name_);
    return;
  }
  ByteReader in(bytes, name_);
  in.skip(4);
  if (const auto version = in.read<std::uint32_t>(); version != 2)
    fail(ErrorKind::data, "{}: glTF version {} is not supported, only 2", name_, version);
  in.skip(4);
  if (in.remaining() < 8) fail(ErrorKind::data, "{}: truncated: the file has no JSON chunk", name_);
  bool first = true;
  while (in.remaining() >= 8) {
    const auto size = in.read<std::uint32_t>(), kind = in.read<std::uint32_t>();
    const auto chunk = in.take(size);
    if (first && kind != kGltfJsonChunk)
      fail(ErrorKind::data, "{}: the file does not start with its JSON chunk", name_);
    if (first) {
      json_ = parse_json({reinterpret_cast<const char*>(chunk.data()), chunk.size()}, name_);
      limit_members(json_, name_);
    }
    if (kind == kGltfBinChunk && bin_.empty()) bin_ = chunk;
    first = false;
  }
}

std::size_t GltfFile::count(std::size_t accessor) const {
  return json_.at("accessors").at(accessor).at("count").get<std::size_t>();
}

std::string GltfFile::type(std::size_t accessor) const {
  return json_.at("accessors").at(accessor).at("type").get<std::string>();
}

std::size_t GltfFile::loaded_bytes() const {
  std::size_t bytes = 0;
  for (const auto& [index, buffer] : buffers_) bytes += buffer.size();
  return bytes;
}

std::vector<std::byte> GltfFile::read_uri(const std::string& uri) const {
  if (uri.starts_with("data:")) {
    constexpr std::string_view kBase64 = ";base64,";
    const std::size_t at = uri.find(kBase64);
    if (at == std::string::npos)
      fail(ErrorKind::data, "{}: a data URI is not in base64, the only form that is supported", name_);
    return decode_base64(std::string_view(uri).substr(at + kBase64.size()), name_);
  }
  if (uri.find("://") != std::string::npos)
    fail(ErrorKind::data, "{}: the numbers are at the address '{}': download that file, and state its name",
         name_, uri.substr(0, 80));
  if (path_.empty()) fail(ErrorKind::data, "{}: the file '{}' is not in this file", name_, uri.substr(0, 80));
  return read_file(file_beside(path_, decode_percent(uri)));
}

std::span<const std::byte> GltfFile::buffer(std::size_t index) {
  if (const auto known = buffers_.find(index); known != buffers_.end()) return known->second;
  const Json& buffer = json_.at("buffers").at(index);
  std::span<const std::byte> bytes = bin_;
  if (buffer.contains("uri"))
    bytes = read_.emplace(index, read_uri(buffer["uri"].get<std::string>())).first->second;
  else if (!binary_ || index != 0)
    fail(ErrorKind::data, "{}: buffer {} has no uri, so its values are missing", name_, index);
  const auto size = buffer.at("byteLength").get<std::size_t>();
  if (size > bytes.size())
    fail(ErrorKind::data, "{}: truncated: buffer {} has {} bytes, but the file states {}", name_, index,
         bytes.size(), size);
  return buffers_[index] = bytes;
}

GltfFile::View GltfFile::view_of(std::size_t index) {
  const Json& accessor = json_.at("accessors").at(index);
  if (accessor.contains("sparse")) fail(ErrorKind::data, "{}: sparse accessors are not supported", name_);
  if (!accessor.contains("bufferView"))
    fail(ErrorKind::data, "{}: accessor {} has no bufferView, so its values are missing", name_, index);
  const Json& view = json_.at("bufferViews").at(accessor.at("bufferView").get<std::size_t>());
  const std::span<const std::byte> all = buffer(view.at("buffer").get<std::size_t>());
  const std::size_t begin = view.value("byteOffset", std::size_t{0}),
                    size = view.at("byteLength").get<std::size_t>(),
                    inside = accessor.value("byteOffset", std::size_t{0});
  if (begin > all.size() || size > all.size() - begin || inside > size)
    fail(ErrorKind::data, "{}: accessor {} does not fit into the file", name_, index);
  return {all.subspan(begin + inside, size - inside), view.value("byteStride", std::size_t{0})};
}

std::vector<float> GltfFile::read(std::size_t index, std::size_t width, std::size_t count) {
  const View view = view_of(index);
  const Json& accessor = json_.at("accessors").at(index);
  if (this->count(index) != count)
    fail(ErrorKind::data, "{}: accessor {} has a different number of splats than POSITION", name_, index);
  if (type(index) != (width == 1 ? "SCALAR" : width == 3 ? "VEC3" : "VEC4"))
    fail(ErrorKind::data, "{}: accessor {} is not of the type {}", name_, index,
         width == 1   ? "SCALAR"
         : width == 3 ? "VEC3"
                      : "VEC4");
  const int kind = accessor.at("componentType").get<int>();
  const Component component = component_of(kind, name_);
  const std::size_t row = width * component.bytes, stride = view.stride == 0 ? row : view.stride;
  if (stride < row || stride > 252 ||
      (count > 0 && (view.bytes.size() < row || (view.bytes.size() - row) / stride < count - 1)))
    fail(ErrorKind::data, "{}: accessor {} does not fit into the file, or its stride is invalid", name_,
         index);
  const bool normalised = accessor.value("normalized", false);
  std::vector<float> values;
  values.reserve(count * width);
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = 0; k < width; ++k) {
      const float v = component_at(view.bytes.data() + i * stride + k * component.bytes, kind);
      values.push_back(normalised ? std::max(-1.0f, v / static_cast<float>(component.most)) : v);
    }
  return values;
}

}  // namespace ubs
