// SPDX-License-Identifier: Apache-2.0
// Reading whole files, and writing files that are never seen half done: the data go to a temporary file in
// the same folder, which takes the final name in one rename. Every failure names the path.
//
// Results are on the disk when commit() returns: the file is synchronised before the rename, its folder after
// it. So a power cut leaves the old file or the new one, and what was written before another file is there if
// that one is.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ubs {

// Opens an existing regular file and returns its size through `size` (folders open without error in
// iostreams and only fail at the first read, so this checks first).
std::ifstream open_for_reading(const std::filesystem::path& path, std::size_t& size);

std::vector<std::byte> read_file(const std::filesystem::path& path);
std::string read_text_file(const std::filesystem::path& path);

// Throws Error(data) if there is something of that name that is not an ordinary file (a folder, a symbolic
// link, a device): a rename would replace the link or the device itself.
void check_ordinary(const std::filesystem::path& path);

enum class FileUse {
  result,  // synchronised
  cache  // not synchronised: it can be made again, readers must notice damage, and waiting for the disk could
         // cost more than making it
};

// Writes into ".ubs-tmp-<process>-<number><suffix>" beside `path` until commit(), which replaces the file of
// that name; a destructor without commit removes the temporary file. While it is written it is locked
// (flock): an unlocked one was left by a killed process, and is removed when a process writes its first file
// into the folder.
class AtomicFile {
 public:
  // Throws Error(data) if `path` is not an ordinary file, or cannot be written.
  explicit AtomicFile(std::filesystem::path path, FileUse use = FileUse::result,
                      std::string_view suffix = {});
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(std::span<const std::byte> bytes);
  void write(std::string_view text) { write(std::as_bytes(std::span(text))); }
  void commit();

  // For encoders that take a name, and for parts of the file that other processes write.
  const std::filesystem::path& temporary() const { return temporary_; }
  // Leaves room for `bytes` that another process writes into temporary() (PartOfFile).
  void skip(std::uint64_t bytes);

 private:
  void flush();
  void put(std::span<const std::byte> bytes);

  std::filesystem::path path_, temporary_;
  FileUse use_;
  int file_ = -1;
  std::vector<std::byte> buffer_;
};

// A part of the temporary file of an AtomicFile that another process writes.
class PartOfFile {
 public:
  explicit PartOfFile(std::filesystem::path temporary);
  ~PartOfFile();
  PartOfFile(const PartOfFile&) = delete;
  PartOfFile& operator=(const PartOfFile&) = delete;
  void write(std::uint64_t offset, std::span<const std::byte> bytes);
  void sync();

 private:
  std::filesystem::path path_;
  int file_;
};

void write_file_atomically(const std::filesystem::path& path, std::span<const std::byte> bytes,
                           FileUse use = FileUse::result);
void write_file_atomically(const std::filesystem::path& path, std::string_view text,
                           FileUse use = FileUse::result);

// Removes temporary files in the folder that killed processes have left: those that nobody holds by flock.
void remove_abandoned(const std::filesystem::path& folder);

}  // namespace ubs
