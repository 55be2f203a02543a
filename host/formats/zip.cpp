// SPDX-License-Identifier: Apache-2.0
// See zip.hpp.
#include "host/formats/zip.hpp"

#include <algorithm>

#include "host/base/byte_reader.hpp"
#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

constexpr std::uint32_t kLocal = 0x04034b50, kCentral = 0x02014b50, kEnd = 0x06054b50;
constexpr std::size_t kEndBytes = 22, kLongestComment = 65535;
constexpr std::uint16_t kVersion = 20, kFirstDay = 0x21;  // 1 January 1980

// Writes the part that is the same in the local and in the central header of a member. It starts with the
// flags.
void put_member(std::vector<std::byte>& out, std::uint32_t crc, std::size_t size, const std::string& name) {
  for (const std::uint16_t v : {std::uint16_t{0}, std::uint16_t{0}, std::uint16_t{0}, kFirstDay})
    put_number(out, v);
  put_number(out, crc);
  for (int twice = 0; twice < 2; ++twice) put_number(out, static_cast<std::uint32_t>(size));
  put_number(out, static_cast<std::uint16_t>(name.size()));
  put_number(out, std::uint16_t{0});
}

void put_text(std::vector<std::byte>& out, const std::string& text) {
  for (const char c : text) out.push_back(static_cast<std::byte>(c));
}

// Reads the entries of the directory, which is at the start of `in`.
std::map<std::string, ZipReader::Member> read_directory(ByteReader in, std::size_t count) {
  std::map<std::string, ZipReader::Member> members;
  for (std::size_t i = 0; i < count; ++i) {
    ZipReader::Member member;
    if (in.read<std::uint32_t>() != kCentral)
      fail(ErrorKind::data, "{}: the directory of the ZIP archive is damaged", in.name());
    in.skip(4);
    member.flags = in.read<std::uint16_t>(), member.method = in.read<std::uint16_t>();
    in.skip(4);
    member.crc = in.read<std::uint32_t>();
    member.packed = in.read<std::uint32_t>(), member.size = in.read<std::uint32_t>();
    const auto text = in.read<std::uint16_t>(), extra = in.read<std::uint16_t>();
    const auto comment = in.read<std::uint16_t>();
    in.skip(8);
    member.at = in.read<std::uint32_t>();
    const auto letters = in.take(text);
    members[{reinterpret_cast<const char*>(letters.data()), letters.size()}] = member;
    in.skip(std::size_t{extra} + comment);
  }
  return members;
}

}  // namespace

void ZipWriter::add(const std::string& name, std::span<const std::byte> bytes) {
  if (out_.size() + bytes.size() > 0xf0000000u)
    fail(ErrorKind::data, "{}: a ZIP archive cannot contain more than 4 GB", name);
  const std::uint32_t crc = crc32(bytes), at = static_cast<std::uint32_t>(out_.size());
  put_number(out_, kLocal), put_number(out_, kVersion);
  put_member(out_, crc, bytes.size(), name);
  put_text(out_, name);
  out_.insert(out_.end(), bytes.begin(), bytes.end());
  put_number(directory_, kCentral), put_number(directory_, kVersion), put_number(directory_, kVersion);
  put_member(directory_, crc, bytes.size(), name);
  for (int k = 0; k < 3; ++k) put_number(directory_, std::uint16_t{0});  // comment, disk and attributes
  put_number(directory_, std::uint32_t{0});
  put_number(directory_, at);
  put_text(directory_, name);
  ++members_;
}

std::vector<std::byte> ZipWriter::finish() {
  const auto at = static_cast<std::uint32_t>(out_.size());
  out_.insert(out_.end(), directory_.begin(), directory_.end());
  put_number(out_, kEnd), put_number(out_, std::uint32_t{0});  // this disk and the disk of the directory
  for (int twice = 0; twice < 2; ++twice) put_number(out_, static_cast<std::uint16_t>(members_));
  put_number(out_, static_cast<std::uint32_t>(directory_.size())), put_number(out_, at);
  put_number(out_, std::uint16_t{0});
  return std::move(out_);
}

ZipReader::ZipReader(std::span<const std::byte> file, std::string name)
    : file_(file), name_(std::move(name)) {
  const auto is_end = [&](std::size_t at) {
    return ByteReader(file_.subspan(at), name_).read<std::uint32_t>() == kEnd;
  };
  if (file_.size() < kEndBytes) fail(ErrorKind::data, "{}: truncated ZIP archive", name_);
  std::size_t end = file_.size() - kEndBytes;
  const std::size_t first = end - std::min(end, kLongestComment);
  while (end > first && !is_end(end)) --end;
  if (!is_end(end)) fail(ErrorKind::data, "{}: not a ZIP archive, or truncated", name_);
  ByteReader tail(file_.subspan(end), name_);
  tail.skip(10);
  const auto count = tail.read<std::uint16_t>();
  tail.skip(4);
  const auto at = tail.read<std::uint32_t>();
  if (at > end) fail(ErrorKind::data, "{}: the directory of the ZIP archive is damaged", name_);
  members_ = read_directory(ByteReader(file_.first(end).subspan(at), name_), count);
}

std::vector<std::string> ZipReader::names() const {
  std::vector<std::string> names;
  for (const auto& [name, member] : members_) names.push_back(name);
  return names;
}

std::vector<std::byte> ZipReader::get(const std::string& member, std::size_t most_bytes) const {
  const std::string name = fmt::format("{}: {}", name_, member);
  const auto found = members_.find(member);
  if (found == members_.end()) fail(ErrorKind::data, "{}: the archive does not contain this file", name);
  const Member& m = found->second;
  if (m.size > most_bytes)
    fail(ErrorKind::data, "{}: {} bytes are too many: at most {} are expected", name, m.size, most_bytes);
  if (m.at > file_.size()) fail(ErrorKind::data, "{}: damaged ZIP archive", name);
  ByteReader in(file_.subspan(m.at), name);
  if (in.read<std::uint32_t>() != kLocal) fail(ErrorKind::data, "{}: damaged ZIP archive", name);
  in.skip(22);
  const auto text = in.read<std::uint16_t>(), extra = in.read<std::uint16_t>();
  in.skip(std::size_t{text} + extra);
  if (m.flags & 1) fail(ErrorKind::data, "{}: the file is encrypted, which is not supported", name);
  if (m.method != 0 && m.method != 8)
    fail(ErrorKind::data, "{}: the file is compressed with method {}, but only methods 0 and 8 are supported",
         name, m.method);
  const auto packed = in.take(m.packed);
  if (m.size / kMaxDeflateRatio > packed.size()) fail(ErrorKind::data, "{}: damaged ZIP archive", name);
  std::vector<std::byte> bytes = m.method == 0 ? std::vector<std::byte>(packed.begin(), packed.end())
                                               : inflate_raw(packed, std::size_t{m.size} + 1, name);
  if (bytes.size() != m.size || crc32(bytes) != m.crc) fail(ErrorKind::data, "{}: the file is damaged", name);
  return bytes;
}

std::vector<std::string> zip_member_names(const std::filesystem::path& path) {
  constexpr std::size_t kLargestDirectory = std::size_t{64} << 20;
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  const auto read = [&](std::size_t at, std::size_t count) {
    std::vector<std::byte> bytes(count);
    stream.seekg(static_cast<std::streamoff>(at));
    stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(count));
    bytes.resize(static_cast<std::size_t>(stream.gcount()));
    return bytes;
  };
  const std::size_t looked_at = std::min(size, kEndBytes + kLongestComment);
  const std::vector<std::byte> tail = read(size - looked_at, looked_at);
  for (std::size_t end = tail.size(); end-- > 0;) {
    ByteReader in(std::span<const std::byte>{tail}.subspan(end), path.string());
    if (in.remaining() < kEndBytes || in.read<std::uint32_t>() != kEnd) continue;
    in.skip(6);
    const std::size_t count = in.read<std::uint16_t>(), bytes = in.read<std::uint32_t>();
    const std::size_t at = in.read<std::uint32_t>();
    if (bytes > kLargestDirectory || at > size || bytes > size - at) return {};
    const std::vector<std::byte> directory = read(at, bytes);
    std::vector<std::string> names;
    try {
      for (const auto& [name, member] : read_directory(ByteReader(directory, path.string()), count))
        names.push_back(name);
    } catch (const Error&) {  // the directory is damaged; the reader of the archive reports the error
      return {};
    }
    return names;
  }
  return {};
}

}  // namespace ubs
