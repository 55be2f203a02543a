// SPDX-License-Identifier: Apache-2.0
// Whole-file reading, and writing that is never seen half done: data go to a temporary file in the
// same folder, which takes the final name in one rename. Every failure names the path.
//
// Results are on the disk when commit() returns: the file is synchronised before the rename, its folder
// behind it. So a power cut leaves the old file or the new one, and what was written before another file is
// there if that one is.
#pragma once

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/made_files.hpp"

namespace ubs {

// Opens an existing regular file and returns its size through `size` (folders open without error in
// iostreams and only fail at the first read, so this checks first).
std::ifstream open_for_reading(const std::filesystem::path& path, std::size_t& size);

std::vector<std::byte> read_file(const std::filesystem::path& path);
std::string read_text_file(const std::filesystem::path& path);

// What a file is for decides what it may replace and whether it is waited for.
enum class FileUse {
  result,   // replaces only what an earlier run of the same command made (made_files.hpp); synchronised
  log,      // as a result; it grows afterwards, so that only its beginning is compared
  setting,  // in a folder of ours alone: replaces what has its name; synchronised
  cache     // as a setting, but not synchronised: it can be made again, readers must notice damage, and
            // waiting for the disk could cost more than making it
};

// Writes into ".ubs-tmp-<process>-<number><suffix>" beside `path` until commit(); a destructor without
// commit removes it. While it is written it is locked (flock): what is found unlocked was left by a killed
// process, and is removed when a process writes its first file into the folder.
class AtomicFile {
 public:
  // Throws Error(usage) where `path` may not be replaced, Error(data) where it cannot be written.
  explicit AtomicFile(std::filesystem::path path, FileUse use = FileUse::result,
                      std::string_view suffix = {});
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(std::span<const std::byte> bytes);
  void write(std::string_view text) { write(std::as_bytes(std::span(text))); }
  void commit();
  // What has been written so far.
  const Content& content();
  // Behind that, others have written so much into temporary() (PartOfFile).
  void skip(const Content& written);

  // For encoders that take a name: what they write there, and nothing through write(), is committed.
  const std::filesystem::path& temporary() const { return temporary_; }

 private:
  void flush();
  void put(std::span<const std::byte> bytes);
  void take_other_content();

  std::filesystem::path path_, temporary_;
  FileUse use_;
  int file_ = -1;
  std::vector<std::byte> buffer_;
  Content content_;  // of what was written
};

// A part of the temporary file of an AtomicFile that another process has made.
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

}  // namespace ubs
