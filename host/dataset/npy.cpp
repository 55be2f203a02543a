// SPDX-License-Identifier: Apache-2.0
// See npy.hpp. A file starts with "\x93NUMPY", the version (2 bytes) and the length of the header (2 bytes,
// little-endian). The header is a Python dict literal, which is padded with spaces and ends with a newline,
// so that the data after it start at a multiple of 64 bytes.
#include "host/dataset/npy.hpp"

#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string>

#include "host/base/error.hpp"
#include "host/base/file.hpp"

namespace ubs {

static_assert(std::endian::native == std::endian::little, "the file readers copy little-endian data as is");

namespace {

constexpr std::string_view kMagic("\x93NUMPY\x01\x00", 8);
constexpr std::size_t kPrefix = 10;

struct NpyHeader {
  bool wide = false;               // float64
  std::vector<std::size_t> shape;  // empty for a scalar
  std::size_t count = 1;           // number of elements
  std::size_t data = 0;            // offset of the first element in the file [bytes]
};

// Returns the product of the extents. Throws if the product is larger than `limit`; it cannot overflow.
std::size_t element_count(const std::vector<std::size_t>& shape, std::size_t limit, const std::string& name) {
  std::size_t count = 1;
  for (const std::size_t extent : shape)
    if (extent == 0) return 0;
  for (const std::size_t extent : shape) {
    if (extent > limit / count)
      fail(ErrorKind::data, "{}: the file is truncated: its shape needs more data", name);
    count *= extent;
  }
  return count;
}

// Returns the text between `open` and `close` that follows `key`. A search is enough, because numpy.save
// writes the dictionary in a fixed form.
std::string header_value(const std::string& header, const std::string& key, const std::string& open,
                         const std::string& close, const std::string& name) {
  const std::string start = "'" + key + "': " + open;
  const auto first = header.find(start);
  const auto last = first == std::string::npos ? first : header.find(close, first + start.size());
  if (last == std::string::npos) fail(ErrorKind::data, "{}: malformed .npy header: {} is missing", name, key);
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
    if (result.ec != std::errc()) fail(ErrorKind::data, "{}: invalid extent in shape ({})", name, text);
    shape.push_back(extent);
    at = result.ptr;
  }
  return shape;
}

NpyHeader parse_header(std::string_view content, const std::string& name) {
  if (content.size() < kPrefix || content.compare(0, 6, kMagic, 0, 6) != 0)
    fail(ErrorKind::data, "{}: not a .npy file", name);
  if (content.compare(0, 8, kMagic) != 0)
    fail(ErrorKind::data, "{}: .npy format {}.{} is not supported, only 1.0", name, int{content[6]},
         int{content[7]});
  const std::size_t length =
      static_cast<unsigned char>(content[8]) + 256u * static_cast<unsigned char>(content[9]);
  if (content.size() < kPrefix + length) fail(ErrorKind::data, "{}: truncated .npy header", name);
  const std::string text(content.substr(kPrefix, length));

  NpyHeader header;
  const std::string type = header_value(text, "descr", "'", "'", name);
  header.wide = type == "<f8";
  if (!header.wide && type != "<f4")
    fail(ErrorKind::data, "{}: element type '{}' is not supported: save as float32 ('<f4') or float64", name,
         type);
  const std::size_t item = header.wide ? sizeof(double) : sizeof(float);
  const std::string order = header_value(text, "fortran_order", "", ",", name);
  if (order == "True")
    fail(ErrorKind::data, "{}: Fortran order is not supported: save with np.ascontiguousarray", name);
  if (order != "False") fail(ErrorKind::data, "{}: malformed .npy header: fortran_order is {}", name, order);
  header.shape = parse_shape(header_value(text, "shape", "(", ")", name), name);
  header.data = kPrefix + length;
  const std::size_t available = content.size() - header.data;
  header.count = element_count(header.shape, available / item, name);
  if (available != header.count * item)
    fail(ErrorKind::data, "{}: {} bytes of data, but the shape needs {}", name, available,
         header.count * item);
  return header;
}

template <typename T>
std::vector<T> copy_values(const std::string& content, const NpyHeader& header) {
  std::vector<T> values(header.count);
  if (header.count > 0) std::memcpy(values.data(), content.data() + header.data, header.count * sizeof(T));
  return values;
}

}  // namespace

NpyArray read_npy(const std::filesystem::path& path) {
  NpyArray64 wide = read_npy_double(path);
  NpyArray array{std::move(wide.shape), std::vector<float>(wide.values.size())};
  for (std::size_t i = 0; i < wide.values.size(); ++i) {
    array.values[i] = static_cast<float>(wide.values[i]);
    if (std::isfinite(wide.values[i]) && !std::isfinite(array.values[i]))
      fail(ErrorKind::data, "{}: value {} is {:g}, which exceeds float32", path.string(), i, wide.values[i]);
  }
  return array;
}

NpyArray64 read_npy_double(const std::filesystem::path& path) {
  const std::string content = read_text_file(path);
  NpyHeader header = parse_header(content, path.string());
  if (header.wide) return {std::move(header.shape), copy_values<double>(content, header)};
  const std::vector<float> values = copy_values<float>(content, header);
  return {std::move(header.shape), {values.begin(), values.end()}};
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
    fail(ErrorKind::internal, "{}: shape ({}) does not match {} values", path.string(), extents,
         values.size());
  if (shape.size() > 1) extents.pop_back();  // Python writes a final comma only for one extent, as in (3,)
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
