// SPDX-License-Identifier: Apache-2.0
#include "host/base/folder_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/warning.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

std::string this_holder() {
  char host[256] = {}, date[32] = {};
  gethostname(host, sizeof host - 1);
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  std::strftime(date, sizeof date, "%Y-%m-%d %H:%M:%S UTC", gmtime_r(&now, &parts));
  return fmt::format("process {} on {}, since {}", getpid(), host, date);
}

std::string holder_in(const fs::path& path) {
  try {
    std::string text = read_text_file(path);
    while (!text.empty() && text.back() == '\n') text.pop_back();
    return text.empty() ? "another process" : text;
  } catch (const std::exception&) {
    return "another process";
  }
}

// Returns whether an open file is the one that has this path.
bool is_same(int file, const fs::path& path, bool follow) {
  struct stat opened {
  }, named{};
  return ::fstat(file, &opened) == 0 &&
         (follow ? ::stat(path.c_str(), &named) : ::lstat(path.c_str(), &named)) == 0 &&
         opened.st_ino == named.st_ino && opened.st_dev == named.st_dev;
}

bool is_unsupported(int reason) {
  return reason == ENOLCK || reason == ENOSYS || reason == EOPNOTSUPP || reason == EINVAL;
}

}  // namespace

FolderLock::FolderLock(fs::path folder) : folder_(std::move(folder)), path_(folder_ / ".ubs-lock") {
  for (fs::path at = folder_; !path_exists(at); at = folder_of(at)) made_.push_back(at);
  make_folders(folder_);
  if (!try_once())
    fail(ErrorKind::usage,
         "{}: {} is writing to this folder: wait until it has finished, or choose another folder",
         folder_.string(), holder_in(path_));
  folder_file_ = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
}

bool FolderLock::is_in_place() const { return !held_ || is_same(file_, path_, false); }

void FolderLock::check_place() {
  if (is_in_place()) return;
  if (is_same(folder_file_, folder_, true)) {
    const int before = file_;
    if (try_once()) {
      ::close(before);
      return;
    }
  }
  fail(ErrorKind::data,
       "{}: this folder was removed or replaced while this process was writing to it: the results are not "
       "written, because they would be mixed with other files",
       folder_.string());
}

// The process that holds the lock removes the file when it releases the lock. So between open() and flock()
// the file may have been removed, or replaced by a file of another process. A lock on such a file is useless.
bool FolderLock::try_once() {
  const int file = ::open(path_.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666);
  if (file < 0) fail(ErrorKind::data, "{}: cannot write: {}", path_.string(), std::strerror(errno));
  const bool held = ::flock(file, LOCK_EX | LOCK_NB) == 0;
  if (!held && is_unsupported(errno)) {
    warn_once(fmt::format("{}: this file system does not support locks: do not start two runs in this folder",
                          folder_.string()));
  } else if (!held || !is_same(file, path_, false)) {
    ::close(file);
    return false;
  }
  struct stat status {};
  if (::fstat(file, &status) != 0 || !S_ISREG(status.st_mode) || status.st_nlink != 1) {
    ::close(file);
    fail(ErrorKind::data,
         "{}: this is not an ordinary file with a single name, so ubs does not write to it: remove it",
         path_.string());
  }
  file_ = file;
  held_ = held;
  const std::string text = this_holder() + "\n";
  // The text is only for error messages. The lock does not depend on it, so errors such as a full disk are
  // ignored.
  if (::ftruncate(file, 0) != 0 || ::write(file, text.data(), text.size()) < 0) return true;
  return true;
}

FolderLock::~FolderLock() {
  if (file_ < 0) return;
  if (is_in_place()) {  // otherwise the folder belongs to somebody else
    ::unlink(path_.c_str());
    for (const fs::path& made : made_) ::rmdir(made.c_str());  // fails if the folder is not empty
  }
  ::close(folder_file_);
  ::close(file_);
}

}  // namespace ubs
