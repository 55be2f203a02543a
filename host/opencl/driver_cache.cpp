// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/driver_cache.hpp"

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <mutex>
#include <vector>

#include "host/base/cache_folder.hpp"

namespace ubs::opencl {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr auto kTemporaryAge = 10min;
constexpr auto kTidyEvery = 24h;
constexpr auto kUnusedAge = 90 * 24h;

// Since the last change; zero where there is no such file.
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

// Programs are folders two levels down; PoCL touches the file `last_accessed` in each when it is used.
void remove_unused(const fs::path& folder) {
  std::error_code ignored;
  const fs::path stamp = folder / "tidied";
  if (fs::exists(stamp, ignored) && age(stamp) < kTidyEvery) return;
  std::ofstream(stamp, std::ios::trunc) << "\n";
  for (const fs::path& group : entries_of(folder))
    for (const fs::path& program : entries_of(group))
      if (age(program / "last_accessed") > kUnusedAge) fs::remove_all(program, ignored);
}

SetVariable set_variable = nullptr;

// What the environment gives PoCL, where that can be written, else ours.
fs::path chosen() {
  const char* given = std::getenv("POCL_CACHE_DIR");
  fs::path folder = given && *given ? usable_cache(given) : kernel_cache_folder();
  std::error_code ignored;
  if (given && *given && folder == fs::absolute(given, ignored)) return folder;
  if (folder.empty()) {
    if (std::getenv("POCL_KERNEL_CACHE") == nullptr) set_variable("POCL_KERNEL_CACHE", "0");
    folder = temporary_cache();  // it writes even what it does not keep
  }
  if (folder.empty()) return folder;
  tidy_driver_cache(folder / "pocl");
  return folder / "pocl";
}

void prepare() {
  if (const fs::path folder = chosen(); !folder.empty()) set_variable("POCL_CACHE_DIR", folder.c_str());
}

}  // namespace

void keep_driver_cache(SetVariable set) { set_variable = set; }

void prepare_driver_cache() {
  static std::once_flag once;
  if (set_variable != nullptr) std::call_once(once, prepare);
}

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
