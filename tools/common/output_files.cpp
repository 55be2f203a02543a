// SPDX-License-Identifier: Apache-2.0
#include "tools/common/output_files.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <set>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/formats/splat_file.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

// Returns whether two paths refer to the same file. Returns false if one of them does not exist.
bool same_file(const fs::path& a, const fs::path& b) {
  std::error_code ignored;
  return fs::equivalent(a, b, ignored);
}

// Returns whether `inner` is inside `outer` after resolving symbolic links. Compares inodes, so bind mounts
// are recognised too.
bool is_inside(const fs::path& inner, const fs::path& outer) {
  for (fs::path above = resolved_path(inner); above != above.parent_path();) {
    above = above.parent_path();
    if (same_file(above, outer)) return true;
  }
  return false;
}

// Returns whether loaders look into a folder of this name, even if it does not exist yet (docs/data.md).
bool is_read_by_name(const std::string& name, const fs::path& root) {
  constexpr std::array kNames{"train", "test", "val", "masks", "sparse", "colmap"};
  return name.starts_with("images") || std::ranges::find(kNames, name) != kNames.end() ||
         (name.starts_with("cam") && path_exists(root / "poses_bounds.npy"));
}

// Returns whether the folder contains cameras, or whether loaders of data in `root` would look into it.
bool is_data_folder(const fs::path& folder, const fs::path& root) {
  const fs::path below = resolved_path(folder).lexically_relative(resolved_path(root));
  if (!below.has_parent_path() && is_read_by_name(below.string(), root)) return true;
  if (!is_folder(folder)) return false;
  if (!camera_files_in(folder).empty()) return true;
  return std::ranges::any_of(folder_entries(folder), [](const fs::path& file) {
    const std::string name = file.filename().string();
    return name.starts_with("transforms") || name == "images.bin" || name == "images.txt";
  });
}

[[noreturn]] void refuse_data_folder(const fs::path& folder) {
  fail(ErrorKind::usage,
       "{}: this folder contains images or cameras of the data, or ubs would look for them there: choose "
       "another output folder",
       folder.string());
}

void check_files(const Paths& files, const Paths& inputs, bool overwrite) {
  Paths wanted;
  for (const fs::path& file : files)
    if (!file.empty()) wanted.push_back(file);
  std::set<fs::path> seen;
  for (const fs::path& file : wanted) {
    for (const fs::path& input : inputs)
      if (!input.empty() && same_file(file, input))
        fail(ErrorKind::usage, "{}: this is the input {}: choose another output file", file.string(),
             input.string());
    if (!seen.insert(resolved_path(file)).second)
      fail(ErrorKind::usage, "{}: two results would be written to this file: choose different names",
           file.string());
  }
  check_free(wanted, overwrite);
}

}  // namespace

void add_overwrite_option(CLI::App& app, bool& overwrite) {
  app.add_flag("--overwrite", overwrite, "replace existing files");
}

void check_free(const Paths& files, bool overwrite) {
  for (const fs::path& file : files) {
    check_ordinary(file);
    if (!overwrite && path_exists(file))
      fail(ErrorKind::usage, "{}: already exists: choose another name, or pass --overwrite to replace it",
           file.string());
  }
}

void check_output_files(const Paths& files, const Paths& inputs, bool overwrite) {
  check_files(files, inputs, overwrite);
  for (const fs::path& file : files) {
    if (file.empty()) continue;
    if (access(folder_of(file).c_str(), W_OK | X_OK) != 0)
      fail(ErrorKind::data, "{}: cannot write: {}", file.string(), std::strerror(errno));
  }
}

void check_extension(const fs::path& file, const std::string& what,
                     const std::vector<std::string_view>& extensions) {
  constexpr std::array kOthers{".ubsz", ".ubsd", ".ksplat", ".json", ".csv", ".html",
                               ".htm",  ".mp4",  ".m4v",    ".avi",  ".mkv", ".mov"};
  const std::string extension = small_extension(file);
  const bool known = has_splat_extension(file) || has_image_extension(file) ||
                     std::ranges::find(kOthers, extension) != kOthers.end();
  if (known && std::ranges::find(extensions, extension) == extensions.end())
    fail(ErrorKind::usage, "{}: the output is {}, not a {} file: choose a name that ends with {}",
         file.string(), what, extension, extensions.front());
}

void check_outside(const fs::path& folder, const Paths& data) {
  for (const fs::path& input : data) {
    if (input.empty()) continue;
    if (is_inside(folder, input) && is_data_folder(folder, input)) refuse_data_folder(folder);
    const char* how = same_file(folder, input) ? "is" : is_inside(input, folder) ? "holds" : nullptr;
    if (how)
      fail(ErrorKind::usage,
           "{}: the output folder {} the data folder {}: choose an output folder apart from the data",
           folder.string(), how, input.string());
  }
}

void check_apart_from_images(const fs::path& folder, const Split& views) {
  for (const View& view : views.views)
    if (!view.file.empty() && same_file(folder, folder_of(view.file))) refuse_data_folder(folder);
}

std::unique_ptr<FolderLock> lock_output_folder(const fs::path& folder, const Paths& names, const Paths& data,
                                               bool overwrite) {
  if (folder.empty()) return nullptr;
  if (path_exists(folder) && !is_folder(folder))
    fail(ErrorKind::usage, "{}: this is not a folder", folder.string());
  check_outside(folder, data);
  Paths files;
  for (const fs::path& name : names) files.push_back(folder / name);
  check_files(files, data, overwrite);
  return std::make_unique<FolderLock>(folder);
}

}  // namespace ubs::tools
