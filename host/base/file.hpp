// SPDX-License-Identifier: Apache-2.0
// These functions and classes read whole files, and write files so that other processes never see an
// incomplete file. To this end, the data are written to a temporary file in the same folder, which is then
// renamed to the final name. Every error message contains the path.
//
// When commit() returns for a file with FileUse::result, the file is on the disk, because the file is
// synchronised before it is renamed, and its folder afterwards. Therefore either the old or the new file
// exists after a power failure. If the new file exists, all such files that were written before it exist too.
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

// Opens an existing file and stores its size in `size`. Throws Error(data) for a folder, because
// std::ifstream opens folders without an error, and for a pointer of Git LFS, which takes the place of a file
// that was not downloaded.
std::ifstream open_for_reading(const std::filesystem::path& path, std::size_t& size);

std::vector<std::byte> read_file(const std::filesystem::path& path);
// Skips the UTF-8 byte order mark that some programs of Windows write at the start of text files.
std::string read_text_file(const std::filesystem::path& path);

// Throws Error(data) if `path` exists and is not an ordinary file, but for example a folder, a symbolic link
// or a device. Renaming a temporary file to this path would replace the link or the device itself.
void check_ordinary(const std::filesystem::path& path);

enum class FileUse {
  // commit() waits until the file is on the disk.
  result,
  // commit() does not wait for the disk. This is for files that can be created again, and often faster than
  // they can be written to the disk. Their readers must detect damaged files.
  cache
};

// AtomicFile writes to the file ".ubs-tmp-<process>-<number><suffix>" next to `path`. commit() then renames
// it, which replaces an existing file at `path`. Without commit(), the destructor removes the temporary file.
// The temporary file is locked (flock) while it is written. Therefore a temporary file that is not locked
// must be left over from a killed process. Such files are removed when a process writes its first file to the
// folder.
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
  // Skips the next `bytes` bytes of the file, which another process writes with PartOfFile.
  void skip(std::uint64_t bytes);

 private:
  void flush();
  void put(std::span<const std::byte> bytes);

  std::filesystem::path path_, temporary_;
  FileUse use_;
  int file_ = -1;
  std::vector<std::byte> buffer_;
};

// PartOfFile writes a part of a file for which another process has created an AtomicFile. `temporary` is the
// name that AtomicFile::temporary() returns there.
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

// Removes the temporary files that killed processes have left in the folder. These are the temporary files
// that are not locked (flock).
void remove_abandoned(const std::filesystem::path& folder);

}  // namespace ubs
