// SPDX-License-Identifier: Apache-2.0
// See npy.hpp. Layout: "\x93NUMPY", version (2 bytes), header length (2 bytes, little-endian), a Python
// dict literal padded with spaces and closed by a newline so that the data start at a multiple of 64.
#include "host/data/npy.hpp"

#include <bit>
#include <charconv>
#include <cstring>
#include <string>

#include "host/base/error.hpp"
#include "host/base/file.hpp"

namespace ubs {

static_assert(std::endian::native == std::endian::little, "the file readers copy little-endian data as is");

namespace {

constexpr std::string_view kMagic("\x93NUMPY\x01\x00", 8);
constexpr std::size_t kPrefix = 10;

// Product of the extents, refusing anything larger than `limit` before it can overflow.
std::size_t element_count(const std::vector<std::size_t>& shape, std::size_t limit, const std::string& name) {
  std::size_t count = 1;
  for (const std::size_t extent : shape)
    if (extent == 0) return 0;
  for (const std::size_t extent : shape) {
    if (extent > limit / count) fail(ErrorKind::data, "{}: truncated: the shape needs more data", name);
    count *= extent;
  }
  return count;
}

// Text between the quotes, brackets or comma that enclose the value of `key`; numpy.save writes the
// dictionary in one fixed form, so a search is enough.
std::string header_value(const std::string& header, const std::string& key, const std::string& open,
                         const std::string& close, const std::string& name) {
  const std::string start = "'" + key + "': " + open;
  const auto first = header.find(start);
  const auto last = first == std::string::npos ? first : header.find(close, first + start.size());
  if (last == std::string::npos) fail(ErrorKind::data, "{}: malformed .npy header: no {}", name, key);
  return header.substr(first + start.size(), last - first - start.size());
}

std::vector<std::size_t> parse_shape(const std::string& text, const std::string& name) {
  std::vector<std::size_t> shape;
  const char *at = text.data(), *end = at + text.size();
  while (at != end) {
    if (*at == ',' || *at == ' ') {
      ++at;
      continue;
    }
    std::size_t extent = 0;
    const auto result = std::from_chars(at, end, extent);
    if (result.ec != std::errc()) fail(ErrorKind::data, "{}: absurd extent in shape ({})", name, text);
    shape.push_back(extent);
    at = result.ptr;
  }
  return shape;
}

// Bytes of an element are returned through `element`; 8 only where `allow_double`.
std::vector<std::size_t> parse_header(const std::string& header, const std::string& name, bool allow_double,
                                      std::size_t& element) {
  const std::string type = header_value(header, "descr", "'", "'", name);
  if (type != "<f4" && !(allow_double && type == "<f8"))
    fail(ErrorKind::data, "{}: element type '{}' is not supported: save as float32 ('<f4')", name, type);
  element = type == "<f4" ? sizeof(float) : sizeof(double);
  const std::string order = header_value(header, "fortran_order", "", ",", name);
  if (order == "True")
    fail(ErrorKind::data, "{}: Fortran order is not supported: save with np.ascontiguousarray", name);
  if (order != "False") fail(ErrorKind::data, "{}: malformed .npy header: fortran_order {}", name, order);
  return parse_shape(header_value(header, "shape", "(", ")", name), name);
}

// A checked file: its data start at `data` of `content`.
struct NpyFile {
  std::string content;
  std::vector<std::size_t> shape;
  std::size_t element = 0, count = 0, data = 0;
};

NpyFile read_file_npy(const std::filesystem::path& path, bool allow_double) {
  const std::string name = path.string();
  NpyFile file{read_text_file(path), {}, 0, 0, 0};
  const std::string& content = file.content;
  if (content.size() < kPrefix || content.compare(0, 6, kMagic, 0, 6) != 0)
    fail(ErrorKind::data, "{}: not a .npy file", name);
  if (content.compare(0, 8, kMagic) != 0)
    fail(ErrorKind::data, "{}: .npy format {}.{} is not supported, only 1.0", name, int{content[6]},
         int{content[7]});
  const std::size_t length =
      static_cast<unsigned char>(content[8]) + 256u * static_cast<unsigned char>(content[9]);
  if (content.size() < kPrefix + length) fail(ErrorKind::data, "{}: truncated .npy header", name);
  file.shape = parse_header(content.substr(kPrefix, length), name, allow_double, file.element);
  file.data = kPrefix + length;
  const std::size_t available = content.size() - file.data;
  file.count = element_count(file.shape, available / file.element, name);
  if (available != file.count * file.element)
    fail(ErrorKind::data, "{}: {} bytes of data, but the shape needs {}", name, available,
         file.count * file.element);
  return file;
}

template <typename T>
std::vector<T> copy_values(const NpyFile& file) {
  std::vector<T> values(file.count);
  if (file.count > 0) std::memcpy(values.data(), file.content.data() + file.data, file.count * sizeof(T));
  return values;
}

}  // namespace

NpyArray read_npy(const std::filesystem::path& path) {
  const NpyFile file = read_file_npy(path, false);
  return {file.shape, copy_values<float>(file)};
}

NpyArray64 read_npy_double(const std::filesystem::path& path) {
  const NpyFile file = read_file_npy(path, true);
  if (file.element == sizeof(double)) return {file.shape, copy_values<double>(file)};
  const std::vector<float> values = copy_values<float>(file);
  return {file.shape, {values.begin(), values.end()}};
}

void write_npy(const std::filesystem::path& path, std::span<const std::size_t> shape,
               std::span<const float> values) {
  std::size_t count = 1;
  std::string extents;
  for (const std::size_t extent : shape) {
    count *= extent;
    extents += fmt::format("{}{}", extents.empty() ? "" : " ", extent) + ",";
  }
  if (count != values.size())
    fail(ErrorKind::internal, "{}: shape ({}) does not hold {} values", path.string(), extents,
         values.size());
  if (shape.size() > 1) extents.pop_back();  // Python writes (3,) but (2, 3)
  std::string header = fmt::format("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", extents);
  header.append(63 - (kPrefix + header.size()) % 64, ' ');
  header += '\n';

  AtomicFile file(path);
  file.write(kMagic);
  const char length[2] = {static_cast<char>(header.size() & 255), static_cast<char>(header.size() >> 8)};
  file.write(std::string_view(length, 2));
  file.write(header);
  file.write(std::as_bytes(values));
  file.commit();
}

}  // namespace ubs
