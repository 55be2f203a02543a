// SPDX-License-Identifier: Apache-2.0
// Reads whole files, and writes files so that no process ever sees an incomplete one: the data are written to
// a temporary file in the same folder, which is then renamed to the final name. Every error message contains
// the path.
//
// When commit() returns, the results are on the disk: the file is synchronised before it is renamed, and its
// folder afterwards. So after a power failure there is either the old file or the new one. If a file
// exists then, all files that were written before it exist too.
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
  // Not synchronised, because the file can be created again, and waiting for the disk could take longer than
  // that. Readers must detect damage.
  cache
};

// AtomicFile writes to the file ".ubs-tmp-<process>-<number><suffix>" next to `path`. commit() then renames
// it, which replaces an existing file at `path`. Without commit(), the destructor removes the temporary file.
// The temporary file is locked (flock) while it is written. So an unlocked one must be left over from a
// killed process; such files are removed when a process writes its first file to the folder.
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

  // Returns the name of the temporary file, for encoders that need a name, and for parts of the file that
  // other processes write.
  const std::filesystem::path& temporary() const { return temporary_; }
  // Skips `bytes`, which another process writes to temporary() (PartOfFile).
  void skip(std::uint64_t bytes);

 private:
  void flush();
  void put(std::span<const std::byte> bytes);

  std::filesystem::path path_, temporary_;
  FileUse use_;
  int file_ = -1;
  std::vector<std::byte> buffer_;
};

// PartOfFile writes a part of the temporary file of an AtomicFile that belongs to another process.
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

// Removes temporary files that killed processes have left in the folder: those that are not locked by flock.
void remove_abandoned(const std::filesystem::path& folder);

}  // namespace ubs
