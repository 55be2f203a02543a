// SPDX-License-Identifier: Apache-2.0
#include "host/base/cache_folder.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <vector>

#include "host/base/environment.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/base/warning.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

// Size of the file that is written to check whether a disk has enough space for compiled kernels. With PoCL
// 3.1, the kernels of a training run take 2.2 MiB.
constexpr std::size_t kProbeBytes = std::size_t{4} << 20;

std::string reason(int code) { return std::strerror(code); }

bool write_all(int file, const std::vector<char>& bytes) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::write(file, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<std::size_t>(n);
  }
  return true;
}

// Returns why a file of kProbeBytes cannot be written to the folder, or an empty string if it can.
std::string write_defect(const fs::path& folder) {
  static std::atomic<unsigned> counter{0};
  const std::string file = (folder / fmt::format(".probe-{}-{}", ::getpid(), counter++)).string();
  const int opened = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (opened < 0) return reason(errno);
  std::string why;
  if (!write_all(opened, std::vector<char>(kProbeBytes))) why = reason(errno);
  if (::close(opened) != 0 && why.empty()) why = reason(errno);  // network file systems report the error here
  ::unlink(file.c_str());
  return why;
}

// Returns why the folder cannot be used as a private cache, or an empty string if it can. Creates the folder
// if it is missing. Other users can guess its path, and code is loaded from it, so this user must own the
// folder, and its mode must be 0700.
std::string private_defect(const fs::path& folder) {
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) return reason(errno);
  struct stat status {};
  if (::lstat(folder.c_str(), &status) != 0) return reason(errno);
  if (!S_ISDIR(status.st_mode)) return "it is not a folder";
  if (status.st_uid != ::geteuid() || (status.st_mode & 077) != 0) return "other users have access to it";
  return cache_defect(folder);
}

// Returns why code in the folder cannot be executed, or an empty string if it can.
std::string exec_defect(const fs::path& folder) {
  struct statvfs system {};
  const bool no_exec = ::statvfs(folder.c_str(), &system) == 0 && (system.f_flag & ST_NOEXEC) != 0;
  return no_exec ? "code cannot be run from there (mounted with noexec)" : "";
}

std::recursive_mutex cache_mutex;
std::map<fs::path, fs::path> usable;  // results of usable_cache() by the wanted folder
std::string defects;                  // result of cache_defects()

void note(const std::string& defect) { defects += (defects.empty() ? "" : "; ") + defect; }

fs::path choose(const fs::path& wanted) {
  std::string why = "UBS_KERNEL_CACHE, XDG_CACHE_HOME and HOME are not set";
  if (!wanted.empty()) {
    const std::string defect = cache_defect(wanted);
    if (defect.empty()) return wanted;
    why = fmt::format("{}: {}", wanted.string(), defect);
  }
  note(why);
  const fs::path other = temporary_cache();
  if (other.empty()) return other;
  warn_once(fmt::format(
      "cannot store compiled kernels ({}): using {} instead (choose another folder with UBS_KERNEL_CACHE)",
      why, other.string()));
  return other;
}

}  // namespace

fs::path cache_folder(const char* override_name) {
  if (const std::string folder = environment(override_name); !folder.empty()) return folder;
  if (const std::string cache = environment("XDG_CACHE_HOME"); !cache.empty()) return fs::path(cache) / "ubs";
  if (const std::string home = environment("HOME"); !home.empty()) return fs::path(home) / ".cache" / "ubs";
  return {};
}

std::string cache_defect(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return error.message();
  if (std::string defect = exec_defect(folder); !defect.empty()) return defect;
  return write_defect(folder);
}

fs::path temporary_cache() {
  const std::lock_guard lock(cache_mutex);
  std::error_code error;
  const fs::path system = fs::temp_directory_path(error);
  const fs::path folder = (error ? fs::path("/tmp") : system) / fmt::format("ubs-{}", ::geteuid());
  const std::string defect = private_defect(folder);
  if (defect.empty()) return folder;
  note(fmt::format("{}: {}", folder.string(), defect));
  return {};
}

fs::path process_cache() {
  const std::lock_guard lock(cache_mutex);
  try {
    static const TemporaryFolder folder;  // mkdtemp() sets mode 0700, so other users have no access
    // The free space is not checked here, because the driver reports files that it cannot write.
    const std::string defect = exec_defect(folder.path());
    if (defect.empty()) return folder.path();
    note(fmt::format("{}: {}", folder.path().string(), defect));
  } catch (const Error& error) {
    note(error.what());
  }
  return {};
}

fs::path usable_cache(const fs::path& wanted) {
  const std::lock_guard lock(cache_mutex);
  std::error_code error;
  const fs::path absolute = wanted.empty() ? wanted : fs::absolute(wanted, error);
  const auto found = usable.find(absolute);
  return found != usable.end() ? found->second : usable.emplace(absolute, choose(absolute)).first->second;
}

std::string cache_defects() {
  const std::lock_guard lock(cache_mutex);
  return defects;
}

fs::path kernel_cache_folder() {
  const fs::path wanted = cache_folder("UBS_KERNEL_CACHE");
  return wanted == "off" ? fs::path() : usable_cache(wanted);
}

std::uint64_t name_hash(std::string_view text, std::uint64_t seed) {
  for (const unsigned char c : text) seed = (seed ^ c) * 0x100000001b3u;
  return seed;
}

}  // namespace ubs
