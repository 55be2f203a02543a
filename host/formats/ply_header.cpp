// SPDX-License-Identifier: Apache-2.0
// See ply_header.hpp.
#include "host/formats/ply_header.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <sstream>
#include <utility>

#include "host/base/error.hpp"
#include "host/base/file.hpp"

namespace ubs {

static_assert(std::endian::native == std::endian::little, "vertices are copied from the file as they are");

namespace {

constexpr std::size_t kMaxHeaderLines = 10000;  // splat files have far fewer lines
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
double load(const std::byte* from) {
  T value;
  std::memcpy(&value, from, sizeof(T));
  return static_cast<double>(value);
}

double load_number(const std::byte* from, PlyType type) {
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

// Removes blanks around a line: some programs write blanks after the words of the header.
std::string_view trimmed(std::string_view line) {
  const std::size_t first = line.find_first_not_of(" \t"), last = line.find_last_not_of(" \t");
  return first == std::string_view::npos ? std::string_view() : line.substr(first, last - first + 1);
}

// Reads header lines until end_header.
class HeaderParser {
 public:
  HeaderParser(std::ifstream& stream, std::string name, bool allow_ascii)
      : stream_(stream), name_(std::move(name)), allow_ascii_(allow_ascii) {}

  PlyHeader parse() {
    if (trimmed(next_line()) != "ply") fail(ErrorKind::data, "{}: not a PLY file", name_);
    while (true) {
      const std::string line = next_line();
      if (trimmed(line) == "end_header") break;
      parse_line(line);
    }
    if (!format_seen_) fail(ErrorKind::data, "{}: PLY header has no format line", name_);
    if (header_.elements.empty()) fail(ErrorKind::data, "{}: PLY file has no element vertex", name_);
    static_cast<PlyElement&>(header_) = header_.elements[0];
    header_.lines = line_number_;
    return std::move(header_);
  }

 private:
  std::string where() const { return fmt::format("{}:{}", name_, line_number_); }

  std::string next_line() {
    std::string line;
    if (++line_number_ > kMaxHeaderLines || !std::getline(stream_, line) || stream_.eof())
      fail(ErrorKind::data, "{}: the PLY header has no end_header line; the file may be truncated", name_);
    if (!line.empty() && line.back() == '\r') line.pop_back();
    return line;
  }

  void parse_line(const std::string& line) {
    std::istringstream words(line);
    std::string keyword;
    words >> keyword;
    if (keyword == "comment" || keyword == "obj_info") {
      header_.comments.push_back(line.substr(std::min(line.size(), line.find(keyword) + keyword.size() + 1)));
    } else if (keyword == "format") {
      parse_format(words);
    } else if (keyword == "element") {
      parse_element(words);
    } else if (keyword == "property") {
      parse_property(words);
    } else if (!keyword.empty()) {
      fail(ErrorKind::data, "{}: unknown PLY header line '{}'", where(), line.substr(0, 60));
    }
  }

  void parse_format(std::istringstream& words) {
    std::string format;
    words >> format;
    if (format != "binary_little_endian" && !(allow_ascii_ && format == "ascii"))
      fail(ErrorKind::data, "{}: PLY format '{}' is not supported: save as binary_little_endian", where(),
           format);
    header_.ascii = format == "ascii";
    format_seen_ = true;
  }

  void parse_element(std::istringstream& words) {
    std::string count;
    PlyElement element;
    words >> element.name >> count;
    const auto result = std::from_chars(count.data(), count.data() + count.size(), element.count);
    if (result.ec != std::errc() || result.ptr != count.data() + count.size())
      fail(ErrorKind::data, "{}: invalid {} count '{}'", where(), element.name, count);
    header_.elements.push_back(std::move(element));
  }

  void parse_property(std::istringstream& words) {
    std::string type, property;
    words >> type >> property;
    if (header_.elements.empty())
      fail(ErrorKind::data, "{}: there is a property before any element", where());
    PlyElement& element = header_.elements.back();
    if (type == "list") {
      if (header_.elements.size() == 1)
        fail(ErrorKind::data, "{}: list properties are not supported in element {}", where(), element.name);
      element.has_list = true;
      return;
    }
    if (property.empty()) fail(ErrorKind::data, "{}: a property has no name", where());
    if (element.find(property)) fail(ErrorKind::data, "{}: property '{}' appears twice", where(), property);
    const PlyType parsed = parse_type(type, where());
    element.properties.push_back({property, parsed, element.stride});
    element.stride += ply_type_size(parsed);
  }

  std::ifstream& stream_;
  std::string name_;
  bool allow_ascii_;
  PlyHeader header_;
  bool format_seen_ = false;
  std::size_t line_number_ = 0;
};

// Throws if the number of vertices in the header does not match the `available` bytes after the header. In
// ASCII files, a value takes at least two bytes: a digit and a separator.
void check_size(const PlyHeader& header, std::size_t available, const std::string& name) {
  if (header.stride == 0)
    fail(ErrorKind::data, "{}: element {} has no properties", name, header.PlyElement::name);
  const std::size_t row = header.ascii ? 2 * header.properties.size() : header.stride;
  const std::size_t complete = (available + (header.ascii ? 1 : 0)) / row;
  if (header.count > complete)
    fail(ErrorKind::data, "{}: truncated: the header announces {} vertices, but the file contains {}", name,
         header.count, complete);
  if (!header.ascii && header.elements.size() == 1 && available != header.count * header.stride)
    fail(ErrorKind::data, "{}: {} unexpected bytes after the last vertex: the header does not match the data",
         name, available - header.count * header.stride);
}

void check_elements(const PlyHeader& header, std::size_t available, const std::string& name) {
  for (const PlyElement& element : header.elements) {
    if (element.has_list) fail(ErrorKind::data, "{}: element {} has a list property", name, element.name);
    if (element.stride == 0) continue;  // rows without properties have no bytes
    if (element.count > available / element.stride)
      fail(ErrorKind::data,
           "{}: truncated: the header announces {} rows of element {}, but there are bytes for {}", name,
           element.count, element.name, available / element.stride);
    available -= element.count * element.stride;
  }
  if (available > 0)
    fail(ErrorKind::data,
         "{}: {} unexpected bytes after the last element: the header does not match the data", name,
         available);
}

void check_finite(double value, std::size_t row, const PlyProperty& property, const std::string& name) {
  if (!std::isfinite(value))
    fail(ErrorKind::data, "{}: vertex {}: property '{}' is {}", name, row, property.name, value);
}

// Reads the rows of an ASCII file. Each row is one line. The properties that are not requested must be
// present too; their values are skipped.
template <typename Real>
void read_ascii_rows(std::ifstream& stream, const PlyHeader& header,
                     const std::vector<const PlyProperty*>& properties, const std::vector<Real*>& rows,
                     const std::string& name, NonFinite non_finite) {
  std::vector<double> values(header.properties.size());
  std::string line;
  for (std::size_t i = 0; i < header.count; ++i) {
    const std::string where = fmt::format("{}:{}", name, header.lines + i + 1);
    if (!std::getline(stream, line)) fail(ErrorKind::data, "{}: the file ends before vertex {}", where, i);
    const char* at = line.data();
    const char* const end = at + line.size();
    for (std::size_t p = 0; p < values.size(); ++p) {
      while (at != end && (*at == ' ' || *at == '\t')) ++at;
      const auto result = std::from_chars(at, end, values[p]);
      if (result.ec != std::errc())
        fail(ErrorKind::data, "{}: property '{}' is not a number", where, header.properties[p].name);
      at = result.ptr;
    }
    if (std::string_view(at, end).find_first_not_of(" \t\r") != std::string_view::npos)
      fail(ErrorKind::data, "{}: more values than the {} properties of the element", where, values.size());
    for (std::size_t r = 0; r < properties.size(); ++r) {
      const Real value =
          static_cast<Real>(values[static_cast<std::size_t>(properties[r] - header.properties.data())]);
      if (non_finite == NonFinite::refuse) check_finite(value, i, *properties[r], where);
      rows[r][i] = value;
    }
  }
  // Each row of a further element, such as a face, is also one line. Rows without properties are blank.
  std::size_t promised = 0, found = 0;
  for (std::size_t e = 1; e < header.elements.size(); ++e)
    if (header.elements[e].has_list || header.elements[e].stride > 0) promised += header.elements[e].count;
  while (found <= promised && std::getline(stream, line))
    found += line.find_first_not_of(" \t\r") != std::string::npos;
  if (found != promised)
    fail(ErrorKind::data, "{}: {} {} rows follow the vertices, but the header announces {}", name,
         found > promised ? "at least" : "only", found, promised);
}

template <typename Real>
void read_rows(std::ifstream& stream, const PlyHeader& header,
               const std::vector<const PlyProperty*>& properties, const std::vector<Real*>& rows,
               const std::string& name, NonFinite non_finite) {
  if (header.ascii) return read_ascii_rows(stream, header, properties, rows, name, non_finite);
  const std::size_t block = std::max<std::size_t>(1, kBlockBytes / header.stride);
  std::vector<std::byte> bytes(std::min(block, header.count) * header.stride);
  for (std::size_t first = 0; first < header.count; first += block) {
    const std::size_t n = std::min(block, header.count - first);
    stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(n * header.stride));
    if (!stream) fail(ErrorKind::data, "{}: the file is truncated near vertex {}", name, first);
    for (std::size_t r = 0; r < properties.size(); ++r) {
      const PlyProperty& property = *properties[r];
      for (std::size_t i = 0; i < n; ++i) {
        const Real value =
            static_cast<Real>(load_number(bytes.data() + i * header.stride + property.offset, property.type));
        if (non_finite == NonFinite::refuse) check_finite(value, first + i, property, name);
        rows[r][first + i] = value;
      }
    }
  }
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

const PlyProperty* PlyElement::find(const std::string& property) const {
  const auto it =
      std::find_if(properties.begin(), properties.end(), [&](const auto& p) { return p.name == property; });
  return it == properties.end() ? nullptr : &*it;
}

std::ifstream open_ply(const std::filesystem::path& path, PlyHeader& header, bool allow_ascii) {
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  header = HeaderParser(stream, path.string(), allow_ascii).parse();
  // Some programs call the element of a point cloud "point".
  if (header.name != "vertex" && header.name != "point")
    fail(ErrorKind::data, "{}: the first element is '{}', but must be vertex", path.string(), header.name);
  check_size(header, size - static_cast<std::size_t>(stream.tellg()), path.string());
  return stream;
}

std::ifstream open_ply_elements(const std::filesystem::path& path, PlyHeader& header) {
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  header = HeaderParser(stream, path.string(), false).parse();
  check_elements(header, size - static_cast<std::size_t>(stream.tellg()), path.string());
  return stream;
}

void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<float*>& rows,
                   const std::string& file_name, NonFinite non_finite) {
  read_rows(stream, header, properties, rows, file_name, non_finite);
}

void read_ply_rows(std::ifstream& stream, const PlyHeader& header,
                   const std::vector<const PlyProperty*>& properties, const std::vector<double*>& rows,
                   const std::string& file_name, NonFinite non_finite) {
  read_rows(stream, header, properties, rows, file_name, non_finite);
}

std::string list_names(const std::vector<std::string>& names) {
  // This function splits "motion_8" into "motion_" and 8. A name that does not end with a number is not
  // split.
  const auto parts = [](const std::string& name) {
    const std::size_t last = name.find_last_not_of("0123456789");
    const std::size_t stem = last == std::string::npos ? 0 : last + 1;
    std::size_t number = 0;
    const auto result = std::from_chars(name.data() + stem, name.data() + name.size(), number);
    return std::pair(name.substr(0, stem), result.ec == std::errc() ? std::optional(number) : std::nullopt);
  };
  std::vector<std::string> runs;
  for (std::size_t i = 0, next = 0; i < names.size(); i = next) {
    const auto [stem, first] = parts(names[i]);
    for (next = i + 1; next < names.size() && first; ++next)
      if (const auto [other, number] = parts(names[next]); other != stem || number != *first + (next - i))
        break;
    runs.push_back(next - i > 2 ? names[i] + " to " + names[next - 1] : names[i]);
    if (next - i == 2) next = i + 1;
  }
  return fmt::format("{}", fmt::join(runs, ", "));
}

std::vector<std::string> unused_properties(const PlyElement& element,
                                           const std::vector<const PlyProperty*>& used) {
  std::vector<std::string> names;
  for (const PlyProperty& property : element.properties) {
    const bool normal = property.name == "nx" || property.name == "ny" || property.name == "nz";
    const auto same = [&](const PlyProperty* other) { return other->name == property.name; };
    if (!normal && std::ranges::none_of(used, same)) names.push_back(property.name);
  }
  if (names.empty()) return {};
  return {fmt::format("properties of element '{}' that are not used: {}", element.name, list_names(names))};
}

std::vector<std::string> unused_elements(const PlyHeader& header, std::size_t used) {
  std::vector<std::string> remarks;
  for (std::size_t e = used; e < header.elements.size(); ++e)
    remarks.push_back(
        fmt::format("element '{}' ({} rows) is not used", header.elements[e].name, header.elements[e].count));
  return remarks;
}

std::vector<std::byte> read_ply_bytes(std::ifstream& stream, const PlyElement& element,
                                      const std::string& file_name) {
  std::vector<std::byte> bytes(element.count * element.stride);
  stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (static_cast<std::size_t>(stream.gcount()) != bytes.size())
    fail(ErrorKind::data, "{}: the file is truncated in element {}", file_name, element.name);
  return bytes;
}

}  // namespace ubs
