// SPDX-License-Identifier: Apache-2.0
// See paths.hpp.
#include "host/base/paths.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string>
#include <system_error>

#include "host/base/error.hpp"
#include "host/base/retry_on_eintr.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const fs::path& path, const char* what, const std::error_code& error) {
  fail(ErrorKind::data, "{}: {}: {}", path.string(), what, error.message());
}

void check(const std::error_code& error, const fs::path& path, const char* what) {
  if (error) refuse(path, what, error);
}

fs::file_type type_of(const fs::path& path) {
  std::error_code error;
  const fs::file_type type = fs::status(path, error).type();
  if (type != fs::file_type::none) return type;
  if (error == std::errc::filename_too_long) return fs::file_type::not_found;
  refuse(path, "cannot be accessed", error);
}

}  // namespace

bool path_exists(const fs::path& path) { return type_of(path) != fs::file_type::not_found; }
bool is_folder(const fs::path& path) { return type_of(path) == fs::file_type::directory; }
bool is_regular(const fs::path& path) { return type_of(path) == fs::file_type::regular; }

bool is_dead_link(const fs::path& path) {
  std::error_code ignored;
  return fs::symlink_status(path, ignored).type() == fs::file_type::symlink && !path_exists(path);
}

std::vector<fs::path> folder_entries(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> entries;
  fs::directory_iterator at(folder, error);
  for (; !error && at != fs::directory_iterator(); at.increment(error)) entries.push_back(at->path());
  check(error, folder, "cannot list the folder");
  std::ranges::sort(entries);
  return entries;
}

void make_folders(const fs::path& folder) {
  if (is_folder(folder)) return;
  if (path_exists(folder))
    fail(ErrorKind::data, "{}: this is a file, but a folder is expected", folder.string());
  const fs::path above = folder_of(folder);
  if (above != folder) make_folders(above);
  std::error_code error;
  const bool made = fs::create_directory(folder, error);
  check(error, folder, "cannot create the folder");
  if (made) sync_folder(above);
}

void sync_folder(const fs::path& folder) {
  const int opened = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (opened < 0) refuse(folder, "cannot be opened", {errno, std::generic_category()});
  const int result = retry_on_eintr([&] { return ::fsync(opened); });
  const std::error_code error(result == 0 ? 0 : errno, std::generic_category());
  ::close(opened);
  // Some file systems do not support fsync() for folders. Then this function cannot wait for the disk.
  if (error && error != std::errc::invalid_argument && error != std::errc::not_supported)
    refuse(folder, "cannot be written to the disk", error);
}

fs::path folder_of(const fs::path& file) { return file.has_parent_path() ? file.parent_path() : "."; }

fs::path resolved_path(const fs::path& path) {
  std::error_code error;
  fs::path result = fs::weakly_canonical(path, error);
  if (!error && !result.is_absolute()) result = fs::absolute(result, error).lexically_normal();
  check(error, path, "cannot be resolved");
  return result.has_filename() ? result : result.parent_path();  // without a separator at the end
}

std::string small_extension(const fs::path& file) {
  std::string extension = file.extension().string();
  std::ranges::transform(extension, extension.begin(),
                         [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  return extension;
}

}  // namespace ubs
