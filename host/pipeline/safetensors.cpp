// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/safetensors.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "host/base/byte_reader.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"

namespace ubs {
namespace {

struct Range {  // byte range of a tensor, counted from the first byte after the header
  std::size_t begin, end;
  std::string name;
};

std::optional<std::size_t> size_of(const Json& json) {
  if (!json.is_number_unsigned()) return std::nullopt;
  return json.get<std::size_t>();
}

class HeaderReader {
 public:
  HeaderReader(std::string file, std::span<const std::byte> values)
      : file_(std::move(file)), values_(values) {}

  std::map<std::string, Tensor> read(const Json& header) {
    if (!header.is_object()) fail(ErrorKind::data, "{}: the header is not a JSON object", file_);
    std::map<std::string, Tensor> tensors;
    for (const auto& [name, entry] : header.items())
      if (name != "__metadata__") tensors.emplace(name, tensor(name, entry));
    check_cover();
    return tensors;
  }

 private:
  template <typename... Args>
  [[noreturn]] void refuse(const std::string& name, fmt::format_string<Args...> format,
                           Args&&... args) const {
    fail(ErrorKind::data, "{}: tensor '{}': {}", file_, name,
         fmt::format(format, std::forward<Args>(args)...));
  }

  Tensor tensor(const std::string& name, const Json& entry) {
    if (!entry.is_object() || !entry.contains("dtype") || !entry.contains("shape") ||
        !entry.contains("data_offsets"))
      refuse(name, "needs dtype, shape and data_offsets");
    if (entry["dtype"] != "F32")
      refuse(name,
             "has the type {}, but only F32 is supported: export it again with tools/export_lpips_weights.py",
             entry["dtype"].is_string() ? entry["dtype"].get<std::string>() : "?");
    Tensor result;
    const std::size_t count = read_shape(name, entry["shape"], result.shape);
    const Range range = read_range(name, entry["data_offsets"]);
    if (range.end - range.begin != count * sizeof(float))
      refuse(name, "{} values cannot be stored in {} bytes", count, range.end - range.begin);
    result.values.resize(count);
    if (count > 0) std::memcpy(result.values.data(), values_.data() + range.begin, count * sizeof(float));
    if (!std::ranges::all_of(result.values, [](float v) { return std::isfinite(v); }))
      refuse(name, "contains values that are not finite");
    ranges_.push_back(range);
    return result;
  }

  std::size_t read_shape(const std::string& name, const Json& json, std::vector<std::size_t>& shape) const {
    if (!json.is_array()) refuse(name, "shape is not a list");
    std::size_t count = 1;
    const std::size_t most = values_.size() / sizeof(float);
    for (const Json& extent : json) {
      const auto size = size_of(extent);
      if (!size || (*size > 0 && count > most / *size))
        refuse(name, "shape {} does not match the size of the file", json.dump());
      shape.push_back(*size);
      count *= *size;
    }
    return count;
  }

  Range read_range(const std::string& name, const Json& json) const {
    const bool pair = json.is_array() && json.size() == 2;
    const auto begin = pair ? size_of(json[0]) : std::nullopt, end = pair ? size_of(json[1]) : std::nullopt;
    if (!begin || !end || *begin > *end || *end > values_.size())
      refuse(name, "data_offsets {} must be [BEGIN, END] with 0 <= BEGIN <= END <= {}, the number of bytes",
             json.dump(), values_.size());
    return {*begin, *end, name};
  }

  void check_cover() {
    std::ranges::sort(ranges_, {}, [](const Range& r) { return std::pair(r.begin, r.end); });
    std::size_t at = 0;
    for (const Range& range : ranges_) {
      if (range.begin != at)
        refuse(range.name, "begins at byte {} of the values instead of {}", range.begin, at);
      at = range.end;
    }
    if (at != values_.size())
      fail(ErrorKind::data, "{}: the tensors end at byte {} of {} (damaged file?)", file_, at,
           values_.size());
  }

  std::string file_;
  std::span<const std::byte> values_;
  std::vector<Range> ranges_;
};

}  // namespace

const Tensor& TensorFile::at(const std::string& name) const {
  const auto found = tensors.find(name);
  if (found == tensors.end()) fail(ErrorKind::data, "{}: tensor '{}' is missing", path.string(), name);
  return found->second;
}

TensorFile read_safetensors(const std::filesystem::path& path) {
  const std::vector<std::byte> bytes = read_file(path);
  const std::string file = path.string();
  ByteReader reader(bytes, file);
  const auto length = reader.read<std::uint64_t>();
  if (length > reader.remaining())
    fail(ErrorKind::data,
         "{}: the header should have {} bytes, but only {} follow: is this a safetensors file?", file, length,
         reader.remaining());
  const auto text = reader.take(static_cast<std::size_t>(length));
  const auto header = parse_json({reinterpret_cast<const char*>(text.data()), text.size()}, file);
  return {path, HeaderReader(file, reader.take(reader.remaining())).read(header)};
}

}  // namespace ubs
