// SPDX-License-Identifier: Apache-2.0
// See npz.hpp. A ZIP file is read from its end: the end record names the central directory, whose entries
// name the members (APPNOTE.TXT of PKWARE, sections 4.3.7, 4.3.12, 4.3.16).
#include "host/data/npz.hpp"

#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <string_view>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/data/npy_header.hpp"

namespace ubs {
namespace {

constexpr std::size_t kEndRecord = 22, kDirectoryEntry = 46, kLocalHeader = 30;
constexpr std::uint32_t kEndMark = 0x06054b50, kDirectoryMark = 0x02014b50, kLocalMark = 0x04034b50;
constexpr std::uint32_t kLongest = 1u << 31;  // of a member; beyond it the directory is corrupt

class Bytes {
 public:
  Bytes(std::string_view content, std::string name) : content_(content), name_(std::move(name)) {}

  std::size_t size() const { return content_.size(); }
  std::string_view at(std::size_t position, std::size_t length) const {
    if (position > content_.size() || length > content_.size() - position)
      fail(ErrorKind::data, "{}: truncated or corrupt archive (byte {})", name_, position);
    return content_.substr(position, length);
  }
  template <typename T>
  T number(std::size_t position) const {
    T value;
    std::memcpy(&value, at(position, sizeof value).data(), sizeof value);
    return value;
  }

 private:
  std::string_view content_;
  std::string name_;
};

// The end record, behind which only a comment may follow.
std::size_t find_end(const Bytes& bytes, const std::string& name) {
  for (std::size_t back = kEndRecord; back <= bytes.size() && back <= kEndRecord + 0xffff; ++back)
    if (bytes.number<std::uint32_t>(bytes.size() - back) == kEndMark) return bytes.size() - back;
  fail(ErrorKind::data, "{}: not a .npz archive (no ZIP directory)", name);
}

std::string inflate_member(std::string_view packed, std::size_t size, const std::string& name) {
  // No byte of deflate gives more than 1032 (zlib's manual): a larger claim is corrupt, not a reason to
  // allocate.
  if (size / 1032 > packed.size()) fail(ErrorKind::data, "{}: corrupt compressed data", name);
  std::string out(size, '\0');
  z_stream stream{};
  if (inflateInit2(&stream, -MAX_WBITS) != Z_OK) fail(ErrorKind::internal, "zlib does not start");
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(size);
  const int code = inflate(&stream, Z_FINISH);
  const bool complete = code == Z_STREAM_END && stream.total_out == size;
  inflateEnd(&stream);
  if (!complete) fail(ErrorKind::data, "{}: corrupt compressed data", name);
  return out;
}

std::size_t item_bytes(std::string_view type) {
  if (type == "|u1") return 1;
  if (type == "<f4" || type == "<i4") return 4;
  if (type == "<f8" || type == "<i8") return 8;
  return 0;
}

template <typename T>
void convert(const char* from, std::vector<double>& to) {
  for (std::size_t i = 0; i < to.size(); ++i) {
    T value;
    std::memcpy(&value, from + i * sizeof(T), sizeof(T));
    to[i] = static_cast<double>(value);
  }
}

NpzArray array_of(const std::string& npy, const std::string& name) {
  const NpyHeader header = parse_npy_header(npy, name, item_bytes);
  NpzArray array{header.shape, std::vector<double>(header.count)};
  const char* data = npy.data() + header.data;
  if (header.type == "|u1") convert<std::uint8_t>(data, array.values);
  if (header.type == "<f4") convert<float>(data, array.values);
  if (header.type == "<i4") convert<std::int32_t>(data, array.values);
  if (header.type == "<f8") convert<double>(data, array.values);
  if (header.type == "<i8") convert<std::int64_t>(data, array.values);
  return array;
}

std::string member(const Bytes& bytes, std::size_t entry, const std::string& name) {
  const auto flags = bytes.number<std::uint16_t>(entry + 8), method = bytes.number<std::uint16_t>(entry + 10);
  const auto checksum = bytes.number<std::uint32_t>(entry + 16);
  const auto packed = bytes.number<std::uint32_t>(entry + 20), size = bytes.number<std::uint32_t>(entry + 24);
  const auto local = bytes.number<std::uint32_t>(entry + 42);
  if (flags & 1) fail(ErrorKind::data, "{}: encrypted archives are not supported", name);
  if (method != 0 && method != 8)
    fail(ErrorKind::data, "{}: compression method {} is not supported: save with numpy.savez_compressed",
         name, method);
  if (packed >= kLongest || size >= kLongest)
    fail(ErrorKind::data, "{}: members of 2 GiB and more are not supported", name);
  if (bytes.number<std::uint32_t>(local) != kLocalMark)
    fail(ErrorKind::data, "{}: corrupt archive (no local header)", name);
  const std::size_t start = local + kLocalHeader + bytes.number<std::uint16_t>(local + 26) +
                            bytes.number<std::uint16_t>(local + 28);
  const std::string_view data = bytes.at(start, packed);
  if (method == 0 && packed != size) fail(ErrorKind::data, "{}: corrupt archive (sizes differ)", name);
  std::string content = method == 0 ? std::string(data) : inflate_member(data, size, name);
  if (crc32(0, reinterpret_cast<const Bytef*>(content.data()), static_cast<uInt>(content.size())) != checksum)
    fail(ErrorKind::data, "{}: wrong checksum", name);
  return content;
}

}  // namespace

std::map<std::string, NpzArray> read_npz(const std::filesystem::path& path) {
  const std::string file = path.string(), content = read_text_file(path);
  const Bytes bytes(content, file);
  const std::size_t end = find_end(bytes, file);
  const auto members = bytes.number<std::uint16_t>(end + 10);
  std::size_t entry = bytes.number<std::uint32_t>(end + 16);
  std::map<std::string, NpzArray> arrays;
  for (std::uint16_t i = 0; i < members; ++i) {
    if (bytes.number<std::uint32_t>(entry) != kDirectoryMark)
      fail(ErrorKind::data, "{}: corrupt archive directory", file);
    const auto length = bytes.number<std::uint16_t>(entry + 28);
    std::string name(bytes.at(entry + kDirectoryEntry, length));
    const std::string npy = member(bytes, entry, file + ":" + name);
    if (name.ends_with(".npy")) arrays[name.substr(0, name.size() - 4)] = array_of(npy, file + ":" + name);
    entry += kDirectoryEntry + length + bytes.number<std::uint16_t>(entry + 30) +
             bytes.number<std::uint16_t>(entry + 32);
  }
  return arrays;
}

}  // namespace ubs
