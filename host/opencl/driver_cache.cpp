// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/driver_cache.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <set>
#include <span>
#include <sstream>
#include <vector>

#include "host/base/cache_folder.hpp"
#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/warning.hpp"

namespace ubs::opencl {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr auto kTemporaryAge = 10min;  // temporary files are removed after this time
constexpr auto kTidyEvery = 24h;       // interval between two searches for unused programs
constexpr auto kUnusedAge = 90 * 24h;  // unused programs are removed after this time

// Returns the time since the last change, or zero if the file does not exist.
fs::file_time_type::duration age(const fs::path& file) {
  std::error_code error;
  const auto changed = fs::last_write_time(file, error);
  return error ? fs::file_time_type::duration::zero() : fs::file_time_type::clock::now() - changed;
}

std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
    entries.push_back(at->path());
  return entries;
}

// Removes programs that have not been used for kUnusedAge. Does nothing if the last call was less than
// kTidyEvery ago. Programs are folders two levels below `folder`. PoCL touches the file `last_accessed` in
// the folder of a program whenever it uses the program.
void remove_unused(const fs::path& folder) {
  std::error_code ignored;
  const fs::path stamp = folder / "tidied";
  if (fs::exists(stamp, ignored) && age(stamp) < kTidyEvery) return;
  std::ofstream(stamp, std::ios::trunc) << "\n";
  for (const fs::path& group : entries_of(folder))
    for (const fs::path& program : entries_of(group))
      if (age(program / "last_accessed") > kUnusedAge) fs::remove_all(program, ignored);
}

// FileSum is the stored information about a compiled file. If a file has the same size and time of change,
// and has been checked since the machine was started, it is not checked again.
struct FileSum {
  std::uint32_t crc = 0;
  std::uint64_t size = 0;
  std::int64_t changed = 0;  // ctime [ns]
};
using FileSums = std::map<std::string, FileSum>;  // by the path relative to the cache folder

constexpr const char* kSums = "sums";

std::string boot_id() {
  std::string id;
  std::ifstream("/proc/sys/kernel/random/boot_id") >> id;
  return id;
}

std::int64_t nanoseconds(const timespec& t) { return std::int64_t{1'000'000'000} * t.tv_sec + t.tv_nsec; }

// Returns the time at which the machine was started [ns].
std::int64_t boot_time() {
  timespec now{}, up{};
  ::clock_gettime(CLOCK_REALTIME, &now);
  ::clock_gettime(CLOCK_BOOTTIME, &up);
  return nanoseconds(now) - nanoseconds(up);
}

// Reads the list of check sums. Returns no sums if the list is missing or damaged. Sets `same_boot` to
// whether the list was written since the machine was started.
FileSums read_sums(const fs::path& folder, bool& same_boot) {
  std::string text;
  std::error_code error;
  if (!fs::is_regular_file(folder / kSums, error)) return {};
  try {
    text = read_text_file(folder / kSums);
  } catch (const std::exception&) {
    return {};
  }
  const std::size_t end = text.rfind("end ");
  if (end == std::string::npos ||
      text.substr(end) != fmt::format("end {:08x}\n", crc32(std::as_bytes(std::span(text.data(), end)))))
    return {};
  std::istringstream lines(text.substr(0, end));
  std::string boot, path;
  std::getline(lines, boot);
  same_boot = boot == boot_id();
  FileSums sums;
  for (FileSum sum; lines >> sum.crc >> sum.size >> sum.changed && std::getline(lines >> std::ws, path);)
    sums[path] = sum;
  return sums;
}

void write_sums(const fs::path& folder, const FileSums& sums) {
  std::string text = boot_id() + "\n";
  for (const auto& [path, sum] : sums)
    text += fmt::format("{} {} {} {}\n", sum.crc, sum.size, sum.changed, path);
  text += fmt::format("end {:08x}\n", crc32(std::as_bytes(std::span(text))));
  // AtomicFile cannot be used, because its static objects no longer exist at the end of a process. Damage to
  // the list is detected by its last line.
  const fs::path temporary = folder / fmt::format("tempfile_sums_{}", ::getpid());
  std::ofstream(temporary, std::ios::binary | std::ios::trunc) << text;
  std::error_code ignored;
  fs::rename(temporary, folder / kSums, ignored);
}

// Returns the compiled files. They are in the folders of programs, two levels below `folder`. PoCL gives a
// file its final name when it is complete, and does not change it afterwards.
std::vector<fs::path> compiled_files(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const fs::path& group : entries_of(folder))
    for (const fs::path& program : entries_of(group)) {
      std::error_code error;
      for (fs::recursive_directory_iterator at(program, error), end; !error && at != end; at.increment(error))
        if (const fs::path kind = at->path().extension(); kind == ".so" || kind == ".bc")
          files.push_back(at->path());
    }
  return files;
}

// Compares the files with their stored check sums, and stores the current check sums. If `heal` is true,
// removes the programs of damaged files. Returns the number of removed programs. A file without a stored
// check sum is accepted if it was written since the machine was started. Otherwise a power failure may have
// left it incomplete.
std::size_t check_sums(const fs::path& folder, bool heal) {
  bool same_boot = false, news = false;
  const FileSums known = read_sums(folder, same_boot);
  const std::int64_t boot = boot_time();
  FileSums now;
  std::set<fs::path> damaged;
  for (const fs::path& file : compiled_files(folder)) {
    struct stat status {};
    if (::stat(file.c_str(), &status) != 0) continue;  // another process has removed it
    const fs::path name = file.lexically_relative(folder);
    FileSum sum{0, static_cast<std::uint64_t>(status.st_size), nanoseconds(status.st_ctim)};
    const auto before = known.find(name.string());
    const bool listed = before != known.end();
    if (listed && same_boot && before->second.size == sum.size && before->second.changed == sum.changed) {
      now[name.string()] = before->second;
      continue;
    }
    news = true;
    bool sound = sum.size > 0 && (listed || nanoseconds(status.st_mtim) >= boot);
    try {
      sum.crc = crc32(read_file(file));
      sound = sound && (!listed || sum.crc == before->second.crc);
    } catch (const std::exception&) {
      sound = false;
    }
    if (heal && !sound)
      damaged.insert(folder / *name.begin() / *std::next(name.begin()));
    else
      now[name.string()] = sum;
  }
  for (const fs::path& program : damaged) {
    std::error_code ignored;
    fs::remove_all(program, ignored);
    const std::string below = program.lexically_relative(folder).string() + "/";
    std::erase_if(now, [&](const auto& item) { return item.first.starts_with(below); });
  }
  if (news || now.size() != known.size()) write_sums(folder, now);
  return damaged.size();
}

std::size_t checked_sums(const fs::path& folder, bool heal) noexcept {
  try {
    std::error_code error;
    return fs::is_directory(folder, error) ? check_sums(folder, heal) : 0;
  } catch (const std::exception&) {  // if the list cannot be written, the next start only takes longer
    return 0;
  }
}

// This folder cannot be created. If POCL_CACHE_DIR is this folder, PoCL reports no device, and does not
// choose a folder by itself.
const fs::path kNoFolder = "/dev/null/ubs";
constexpr const char* kFolderVariables[] = {"POCL_CACHE_DIR", "XDG_CACHE_HOME", "HOME"};

SetVariable set_variable = nullptr;

// Returns the folder that the environment specifies for PoCL if it is writable, and otherwise the folder
// `pocl` in the cache folder of ubs. If there is no cache, returns a temporary folder or kNoFolder.
fs::path chosen() {
  const char* given = std::getenv("POCL_CACHE_DIR");
  fs::path folder = given && *given ? usable_cache(given) : kernel_cache_folder();
  std::error_code ignored;
  if (given && *given && folder == fs::absolute(given, ignored)) return folder;
  if (folder.empty()) {
    if (std::getenv("POCL_KERNEL_CACHE") == nullptr) set_variable("POCL_KERNEL_CACHE", "0");
    folder = process_cache();  // PoCL writes files even without a cache
    return folder.empty() ? kNoFolder : folder / "pocl";
  }
  folder /= "pocl";
  tidy_driver_cache(folder);
  if (const std::size_t programs = heal_driver_cache(folder); programs > 0)
    warn_once(
        fmt::format("{} of the compiled programs in {} were damaged, possibly by a power cut: they were "
                    "removed and will be compiled again",
                    programs, folder.string()));
  static const fs::path kept = folder;
  std::atexit([] { record_driver_cache(kept); });
  return folder;
}

void prepare() { set_variable("POCL_CACHE_DIR", chosen().c_str()); }

}  // namespace

void keep_driver_cache(SetVariable set) { set_variable = set; }

void prepare_driver_cache() {
  static std::once_flag once;
  if (set_variable != nullptr) std::call_once(once, prepare);
}

bool driver_has_folder() {
  return std::ranges::any_of(kFolderVariables, [](const char* name) { return !environment(name).empty(); });
}

std::size_t heal_driver_cache(const fs::path& folder) { return checked_sums(folder, true); }

void record_driver_cache(const fs::path& folder) { checked_sums(folder, false); }

void tidy_driver_cache(const fs::path& folder) {
  std::error_code ignored;
  for (const fs::path& file : entries_of(folder)) {
    const std::string name = file.filename().string();
    if ((name.starts_with("tempfile_") || name.starts_with("_temp")) && age(file) > kTemporaryAge)
      fs::remove_all(file, ignored);
  }
  if (fs::is_directory(folder, ignored)) remove_unused(folder);
}

}  // namespace ubs::opencl
