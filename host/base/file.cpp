// SPDX-License-Identifier: Apache-2.0
// See file.hpp.
#include "host/base/file.hpp"

#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <system_error>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"

namespace ubs {

namespace fs = std::filesystem;

std::ifstream open_for_reading(const fs::path& path, std::size_t& size) {
  std::error_code error;
  const auto status = fs::status(path, error);
  if (!fs::exists(status)) fail(ErrorKind::data, "{}: no such file", path.string());
  if (fs::is_directory(status)) fail(ErrorKind::data, "{}: is a folder, expected a file", path.string());
  const auto bytes = fs::file_size(path, error);
  if (error) fail(ErrorKind::data, "{}: cannot read: {}", path.string(), error.message());
  std::ifstream stream(path, std::ios::binary);
  if (!stream) fail(ErrorKind::data, "{}: cannot open: {}", path.string(), std::strerror(errno));
  size = static_cast<std::size_t>(bytes);
  return stream;
}

namespace {

template <typename Container>
Container read_whole(const fs::path& path) {
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  Container content(size, typename Container::value_type{});
  stream.read(reinterpret_cast<char*>(content.data()), static_cast<std::streamsize>(size));
  if (static_cast<std::size_t>(stream.gcount()) != size)
    fail(ErrorKind::data, "{}: read {} of {} bytes", path.string(), stream.gcount(), size);
  return content;
}

// The process number keeps two processes apart, the counter two threads of one.
fs::path temporary_beside(const fs::path& path) {
  static std::atomic<unsigned> counter{0};
  return fs::path(path).concat(fmt::format(".tmp-{}-{}", ::getpid(), counter++));
}

}  // namespace

std::vector<std::byte> read_file(const fs::path& path) { return read_whole<std::vector<std::byte>>(path); }
std::string read_text_file(const fs::path& path) { return read_whole<std::string>(path); }

AtomicFile::AtomicFile(fs::path path) : path_(std::move(path)), temporary_(temporary_beside(path_)) {
  if (is_folder(path_)) fail(ErrorKind::data, "{}: is a folder, cannot write a file", path_.string());
  stream_.open(temporary_, std::ios::binary | std::ios::trunc);
  if (!stream_) fail(ErrorKind::data, "{}: cannot write: {}", path_.string(), std::strerror(errno));
}

AtomicFile::~AtomicFile() {
  if (committed_) return;
  stream_.close();
  std::error_code ignored;
  fs::remove(temporary_, ignored);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  stream_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!stream_) fail(ErrorKind::data, "{}: writing failed (disk full?)", path_.string());
}

void AtomicFile::commit() {
  stream_.close();
  if (!stream_) fail(ErrorKind::data, "{}: writing failed (disk full?)", path_.string());
  std::error_code error;
  fs::rename(temporary_, path_, error);
  if (error) fail(ErrorKind::data, "{}: cannot rename into place: {}", path_.string(), error.message());
  committed_ = true;
}

void write_file_atomically(const fs::path& path, std::span<const std::byte> bytes) {
  AtomicFile file(path);
  file.write(bytes);
  file.commit();
}

void write_file_atomically(const fs::path& path, std::string_view text) {
  write_file_atomically(path, std::as_bytes(std::span(text)));
}

}  // namespace ubs
