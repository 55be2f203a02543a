// SPDX-License-Identifier: Apache-2.0
// See ply_header.hpp.
#include "host/data/ply_header.hpp"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <sstream>

#include "host/base/error.hpp"
#include "host/base/file.hpp"

namespace ubs {

static_assert(std::endian::native == std::endian::little, "vertices are copied from the file as they are");

namespace {

constexpr std::size_t kMaxHeaderLines = 10000;  // a splat file has at most 118 properties
constexpr std::size_t kBlockBytes = std::size_t{1} << 20;

struct TypeName {
  const char* name;
  PlyType type;
};
constexpr TypeName kTypeNames[] = {
    {"char", PlyType::int8},      {"int8", PlyType::int8},       {"uchar", PlyType::uint8},
    {"uint8", PlyType::uint8},    {"short", PlyType::int16},     {"int16", PlyType::int16},
    {"ushort", PlyType::uint16},  {"uint16", PlyType::uint16},   {"int", PlyType::int32},
    {"int32", PlyType::int32},    {"uint", PlyType::uint32},     {"uint32", PlyType::uint32},
    {"float", PlyType::float32},  {"float32", PlyType::float32}, {"double", PlyType::float64},
    {"float64", PlyType::float64}};

PlyType parse_type(const std::string& word, const std::string& where) {
  for (const TypeName& entry : kTypeNames)
    if (word == entry.name) return entry.type;
  fail(ErrorKind::data, "{}: unknown property type '{}'", where, word);
}

template <typename T>
float load(const std::byte* from) {
  T value;
  std::memcpy(&value, from, sizeof(T));
  return static_cast<float>(value);
}

float load_as_float(const std::byte* from, PlyType type) {
  switch (type) {
    case PlyType::int8:
      return load<std::int8_t>(from);
    case PlyType::uint8:
      return load<std::uint8_t>(from);
    case PlyType::int16:
      return load<std::int16_t>(from);
    case PlyType::uint16:
      return load<std::uint16_t>(from);
    case PlyType::int32:
      return load<std::int32_t>(from);
    case PlyType::uint32:
      return load<std::uint32_t>(from);
    case PlyType::float32:
      return load<float>(from);
    case PlyType::float64:
      return load<double>(from);
  }
  return 0;
}

// Reads header lines until end_header. Elements before `vertex` would shift its data and are refused;
// elements after it are of no interest to us.
class HeaderParser {
 public:
  HeaderParser(std::ifstream& stream, std::string name) : stream_(stream), name_(std::move(name)) {}

  PlyHeader parse() {
    if (next_line() != "ply") fail(ErrorKind::data, "{}: not a PLY file", name_);
    while (true) {
      const std::string line = next_line();
      if (line == "end_header") break;
      parse_line(line);
    }
    if (!format_seen_) fail(ErrorKind::data, "{}: PLY header has no format line", name_);
    if (element_ == Element::none) fail(ErrorKind::data, "{}: PLY file has no element vertex", name_);
    return std::move(header_);
  }

  bool vertex_is_last() const { return element_ == Element::vertex; }

 private:
  enum class Element { none, vertex, later };

  std::string where() const { return fmt::format("{}:{}", name_, line_number_); }

  std::string next_line() {
    std::string line;
    if (++line_number_ > kMaxHeaderLines || !std::getline(stream_, line) || stream_.eof())
      fail(ErrorKind::data, "{}: PLY header has no end_header line (file truncated?)", name_);
    if (!line.empty() && line.back() == '\r') line.pop_back();
    return line;
  }

  void parse_line(const std::string& line) {
    std::istringstream words(line);
    std::string keyword;
    words >> keyword;
    if (keyword == "comment") {
      header_.comments.push_back(line.substr(std::min<std::size_t>(line.size(), 8)));
    } else if (keyword == "format") {
      parse_format(words);
    } else if (keyword == "element") {
      parse_element(words);
    } else if (keyword == "property") {
      if (element_ != Element::later) parse_property(words);
    } else if (keyword != "obj_info") {
      fail(ErrorKind::data, "{}: unknown PLY header line '{}'", where(), line.substr(0, 60));
    }
  }

  void parse_format(std::istringstream& words) {
    std::string format;
    words >> format;
    if (format != "binary_little_endian")
      fail(ErrorKind::data, "{}: PLY format '{}' is not supported: save as binary_little_endian", where(),
           format);
    format_seen_ = true;
  }

  void parse_element(std::istringstream& words) {
    std::string element, count;
    words >> element >> count;
    if (element_ != Element::none) {
      element_ = Element::later;
      return;
    }
    if (element != "vertex")
      fail(ErrorKind::data, "{}: the first element is '{}', expected vertex", where(), element);
    const auto result = std::from_chars(count.data(), count.data() + count.size(), header_.count);
    if (result.ec != std::errc() || result.ptr != count.data() + count.size())
      fail(ErrorKind::data, "{}: absurd vertex count '{}'", where(), count);
    element_ = Element::vertex;
  }

  void parse_property(std::istringstream& words) {
    std::string type, property;
    words >> type >> property;
    if (element_ == Element::none) fail(ErrorKind::data, "{}: property before any element", where());
    if (type == "list")
      fail(ErrorKind::data, "{}: list properties are not supported in element vertex", where());
    if (property.empty()) fail(ErrorKind::data, "{}: property without a name", where());
    if (header_.find(property)) fail(ErrorKind::data, "{}: property '{}' appears twice", where(), property);
    const PlyType parsed = parse_type(type, where());
    header_.properties.push_back({property, parsed, header_.stride});
    header_.stride += ply_type_size(parsed);
  }

  std::ifstream& stream_;
  std::string name_;
  PlyHeader header_;
  Element element_ = Element::none;
  bool format_seen_ = false;
  std::size_t line_number_ = 0;
};

void check_size(const PlyHeader& header, std::size_t available, bool vertex_is_last,
                const std::string& name) {
  if (header.stride == 0) fail(ErrorKind::data, "{}: element vertex has no properties", name);
  const std::size_t complete = available / header.stride;
  if (header.count > complete)
    fail(ErrorKind::data, "{}: truncated: the header promises {} vertices, the file holds {}", name,
         header.count, complete);
  if (vertex_is_last && available != header.count * header.stride)
    fail(ErrorKind::data, "{}: {} unexpected bytes after the last vertex: header and data disagree", name,
         available - header.count * header.stride);
}

}  // namespace

std::size_t ply_type_size(PlyType type) {
  switch (type) {
    case PlyType::int8:
    case PlyType::uint8:
      return 1;
    case PlyType::int16:
    case PlyType::uint16:
      return 2;
    case PlyType::int32:
    case PlyType::uint32:
    case PlyType::float32:
      return 4;
    case PlyType::float64:
      return 8;
  }
  return 0;
}

const PlyProperty* PlyHeader::find(const std::string& name) const {
  const auto it =
      std::find_if(properties.begin(), properties.end(), [&](const auto& p) { return p.name == name; });
  return it == properties.end() ? nullptr : &*it;
}

std::ifstream open_ply(const std::filesystem::path& path, PlyHeader& header) {
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  HeaderParser parser(stream, path.string());
  header = parser.parse();
  check_size(header, size - static_cast<std::size_t>(stream.tellg()), parser.vertex_is_last(), path.string());
  return stream;
}

void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<float*>& rows,
                   const std::string& file_name) {
  const std::size_t block = std::max<std::size_t>(1, kBlockBytes / header.stride);
  std::vector<std::byte> bytes(std::min(block, header.count) * header.stride);
  for (std::size_t first = 0; first < header.count; first += block) {
    const std::size_t n = std::min(block, header.count - first);
    stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(n * header.stride));
    if (!stream) fail(ErrorKind::data, "{}: truncated near vertex {}", file_name, first);
    for (std::size_t r = 0; r < properties.size(); ++r) {
      const PlyProperty& property = *properties[r];
      for (std::size_t i = 0; i < n; ++i) {
        const float value = load_as_float(bytes.data() + i * header.stride + property.offset, property.type);
        if (!std::isfinite(value))
          fail(ErrorKind::data, "{}: vertex {}: property '{}' is {}", file_name, first + i, property.name,
               value);
        rows[r][first + i] = value;
      }
    }
  }
}

}  // namespace ubs
