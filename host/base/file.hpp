// SPDX-License-Identifier: Apache-2.0
// Whole-file reading, and writing that is never seen half done: data go to a temporary file in the
// same folder, which takes the final name in one rename. Every failure names the path.
#pragma once

#include <cstddef>
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

// Writes into "<name>.tmp-<process>-<number>" until commit(); a destructor without commit removes it.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(std::span<const std::byte> bytes);
  void write(std::string_view text) { write(std::as_bytes(std::span(text))); }
  void commit();

 private:
  std::filesystem::path path_, temporary_;
  std::ofstream stream_;
  bool committed_ = false;
};

void write_file_atomically(const std::filesystem::path& path, std::span<const std::byte> bytes);
void write_file_atomically(const std::filesystem::path& path, std::string_view text);

}  // namespace ubs
