// SPDX-License-Identifier: Apache-2.0
// ZipWriter writes and ZipReader reads ZIP archives of a few files in memory. The writer does not compress
// the members, because their contents are already compressed. The reader supports compressed and uncompressed
// members. ZIP64 and encryption are not supported.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace ubs {

class ZipWriter {
 public:
  void add(const std::string& name, std::span<const std::byte> bytes);
  // Returns the archive.
  std::vector<std::byte> finish();

 private:
  std::vector<std::byte> out_, directory_;
  std::size_t members_ = 0;
};

// If the archive is damaged, functions throw Error(data) with a message that starts with `name`. The bytes of
// `file` must outlive the reader.
class ZipReader {
 public:
  ZipReader(std::span<const std::byte> file, std::string name);
  // Returns the contents of a member. Throws Error(data) if there is no such member, or if it has more bytes
  // than `most_bytes`.
  std::vector<std::byte> get(const std::string& member, std::size_t most_bytes) const;
  std::vector<std::string> names() const;

  struct Member {
    std::uint16_t flags = 0, method = 0;
    std::uint32_t crc = 0, packed = 0, size = 0, at = 0;
  };

 private:
  std::span<const std::byte> file_;
  std::string name_;
  std::map<std::string, Member> members_;
};

// Returns the names of the members of an archive of any size. Reads only the directory at the end of the
// file. Returns no names if the directory is missing, damaged, larger than 64 MiB or in ZIP64 format.
std::vector<std::string> zip_member_names(const std::filesystem::path& path);

}  // namespace ubs
