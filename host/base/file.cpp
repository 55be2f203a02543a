// SPDX-License-Identifier: Apache-2.0
// See file.hpp.
#include "host/base/file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <set>
#include <system_error>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/base/retry_on_eintr.hpp"

namespace ubs {

namespace fs = std::filesystem;

std::ifstream open_for_reading(const fs::path& path, std::size_t& size) {
  if (is_dead_link(path))
    fail(ErrorKind::data, "{}: this is a symbolic link to a file that does not exist", path.string());
  if (!path_exists(path)) fail(ErrorKind::data, "{}: no such file", path.string());
  if (is_folder(path)) fail(ErrorKind::data, "{}: this is a folder, but a file is expected", path.string());
  std::error_code error;
  const auto bytes = fs::file_size(path, error);
  if (error) fail(ErrorKind::data, "{}: cannot read: {}", path.string(), error.message());
  std::ifstream stream(path, std::ios::binary);
  if (!stream) fail(ErrorKind::data, "{}: cannot open: {}", path.string(), std::strerror(errno));
  // The specification of Git LFS limits a pointer to 1024 bytes.
  constexpr std::string_view kPointer = "version https://git-lfs.github.com/spec/";
  if (bytes >= kPointer.size() && bytes < 1024) {
    std::string start(kPointer.size(), '\0');
    stream.read(start.data(), static_cast<std::streamsize>(start.size()));
    if (start == kPointer)
      fail(ErrorKind::data, "{}: a pointer of Git LFS, not the file: fetch it with 'git lfs pull'",
           path.string());
    stream.clear();
    stream.seekg(0);
  }
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
    fail(ErrorKind::data, "{}: only {} of {} bytes could be read", path.string(), stream.gcount(), size);
  return content;
}

}  // namespace

std::vector<std::byte> read_file(const fs::path& path) { return read_whole<std::vector<std::byte>>(path); }
std::string read_text_file(const fs::path& path) {
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  std::string text = read_whole<std::string>(path);
  if (text.starts_with(kByteOrderMark)) text.erase(0, kByteOrderMark.size());
  return text;
}

namespace {

constexpr std::size_t kBufferBytes = std::size_t{1} << 18;

constexpr const char* kTemporary = ".ubs-tmp-";

// Removes abandoned temporary files from a folder when this process writes its first file to the folder.
void tidy(const fs::path& folder) {
  static std::mutex mutex;
  static std::set<fs::path> known;
  {
    const std::lock_guard lock(mutex);
    if (!known.insert(folder).second) return;
  }
  remove_abandoned(folder);
}

// Creates a new file and locks it. Returns -1 and sets errno if this fails. The file gets a name that no
// other process or thread uses: the name contains the process number and a counter. If a process on another
// machine that shares the disk has created a file of the same name, O_EXCL makes open() fail, and the next
// name is tried.
int open_temporary(const fs::path& folder, std::string_view suffix, fs::path& name) {
  static std::atomic<unsigned> counter{0};
  for (;;) {
    name = folder / fmt::format("{}{}-{}{}", kTemporary, ::getpid(), counter++, suffix);
    const int file =
        retry_on_eintr([&] { return ::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666); });
    if (file < 0 && errno == EEXIST) continue;
    if (file < 0) return file;
    struct stat status {};
    // Between open() and flock(), another process may treat the file as abandoned and lock or delete it. In
    // this case the next name is tried. If flock() fails for another reason, the file system does not support
    // locks, so no process can treat the file as abandoned.
    const bool held = ::flock(file, LOCK_EX | LOCK_NB) == 0;
    const bool taken = held ? ::fstat(file, &status) == 0 && status.st_nlink == 0 : errno == EWOULDBLOCK;
    if (taken) {
      ::close(file);
      continue;
    }
    return file;
  }
}

[[noreturn]] void fail_writing(const fs::path& path) {
  fail(ErrorKind::data, "{}: writing failed: {} (is the disk full?)", path.string(), std::strerror(errno));
}

void sync_or_fail(int file, const fs::path& path) {
  if (retry_on_eintr([&] { return ::fsync(file); }) == 0) return;
  fail(ErrorKind::data, "{}: cannot be written to the disk: {}", path.string(), std::strerror(errno));
}

void rename_or_fail(const fs::path& from, const fs::path& to) {
  if (::rename(from.c_str(), to.c_str()) != 0)
    fail(ErrorKind::data, "{}: cannot rename the temporary file to this name: {}", to.string(),
         std::strerror(errno));
}

}  // namespace

void check_ordinary(const fs::path& path) {
  struct stat status {};
  if (::lstat(path.c_str(), &status) != 0 || S_ISREG(status.st_mode)) return;  // open() will report it
  fail(ErrorKind::data, "{}: this is {}, which ubs does not replace with a file: choose another name",
       path.string(),
       S_ISDIR(status.st_mode)   ? "a folder"
       : S_ISLNK(status.st_mode) ? "a symbolic link"
                                 : "a device, a pipe or a socket");
}

void remove_abandoned(const fs::path& folder) {
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (!at->path().filename().native().starts_with(kTemporary)) continue;
    const int file = ::open(at->path().c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) continue;
    if (::flock(file, LOCK_EX | LOCK_NB) == 0) ::unlink(at->path().c_str());
    ::close(file);
  }
}

AtomicFile::AtomicFile(fs::path path, FileUse use, std::string_view suffix)
    : path_(std::move(path)), use_(use) {
  check_ordinary(path_);
  tidy(folder_of(path_));
  file_ = open_temporary(folder_of(path_), suffix, temporary_);
  if (file_ < 0) fail(ErrorKind::data, "{}: cannot write: {}", path_.string(), std::strerror(errno));
}

AtomicFile::~AtomicFile() {
  if (file_ < 0) return;
  ::unlink(temporary_.c_str());
  ::close(file_);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  if (buffer_.size() + bytes.size() > kBufferBytes) flush();
  if (bytes.size() > kBufferBytes) return put(bytes);
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

void AtomicFile::flush() {
  put(buffer_);
  buffer_.clear();
}

void AtomicFile::put(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const auto written = retry_on_eintr([&] { return ::write(file_, bytes.data(), bytes.size()); });
    if (written < 0) fail_writing(path_);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

void AtomicFile::skip(std::uint64_t bytes) {
  flush();
  if (::lseek(file_, static_cast<off_t>(bytes), SEEK_CUR) < 0) fail_writing(path_);
}

PartOfFile::PartOfFile(fs::path temporary)
    : path_(std::move(temporary)),
      file_(retry_on_eintr([&] { return ::open(path_.c_str(), O_WRONLY | O_CLOEXEC); })) {
  if (file_ < 0) fail(ErrorKind::data, "{}: cannot write: {}", path_.string(), std::strerror(errno));
}

PartOfFile::~PartOfFile() { ::close(file_); }

void PartOfFile::write(std::uint64_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const auto written = retry_on_eintr(
        [&] { return ::pwrite(file_, bytes.data(), bytes.size(), static_cast<off_t>(offset)); });
    if (written < 0) fail_writing(path_);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
    offset += static_cast<std::uint64_t>(written);
  }
}

void PartOfFile::sync() { sync_or_fail(file_, path_); }

void AtomicFile::commit() {
  flush();
  if (use_ == FileUse::result) sync_or_fail(file_, path_);
  rename_or_fail(temporary_, path_);
  ::close(file_);
  file_ = -1;
  if (use_ == FileUse::result) sync_folder(folder_of(path_));
}

void write_file_atomically(const fs::path& path, std::span<const std::byte> bytes, FileUse use) {
  AtomicFile file(path, use);
  file.write(bytes);
  file.commit();
}

void write_file_atomically(const fs::path& path, std::string_view text, FileUse use) {
  write_file_atomically(path, std::as_bytes(std::span(text)), use);
}

}  // namespace ubs
