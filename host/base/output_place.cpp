// SPDX-License-Identifier: Apache-2.0
#include "host/base/output_place.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "host/base/error.hpp"
#include "host/base/made_files.hpp"
#include "host/base/paths.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

// One of the folders above `inner`, all links followed, is `outer`. A folder that is mounted twice counts
// too: folders are compared, not names.
bool lies_in(const fs::path& inner, const fs::path& outer) {
  for (fs::path above = resolved_path(inner); above != above.parent_path();) {
    above = above.parent_path();
    if (same_file(above, outer)) return true;
  }
  return false;
}

// Folders that loaders look into by their names, also where they are missing now (docs/data.md).
bool is_read_by_name(const std::string& name, const fs::path& root) {
  constexpr std::array kNames{"train", "test", "val", "masks", "sparse", "colmap"};
  return name.starts_with("images") || std::ranges::find(kNames, name) != kNames.end() ||
         (name.starts_with("cam") && path_exists(root / "poses_bounds.npy"));
}

bool may_be_input(const fs::path& file) {
  constexpr std::array kEnds{".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".webp",
                             ".bmp", ".mp4", ".avi",  ".mkv", ".mov", ".bin",  ".npy"};
  const std::string name = file.filename().string();
  return std::ranges::find(kEnds, small_extension(file)) != kEnds.end() || name.starts_with("transforms") ||
         name == "cameras.txt" || name == "images.txt";
}

// Whether data in `root` have images or cameras directly in the folder, or would look for some there.
bool is_data_folder(const fs::path& folder, const fs::path& root) {
  const fs::path below = resolved_path(folder).lexically_relative(resolved_path(root));
  if (!below.has_parent_path() && is_read_by_name(below.string(), root)) return true;
  if (!is_folder(folder)) return false;
  return std::ranges::any_of(folder_entries(folder), [&](const fs::path& entry) {
    return is_regular(entry) && may_be_input(entry) && !is_in_list(entry);
  });
}

void check_files(const Paths& files, const Paths& inputs) {
  Paths wanted;
  for (const fs::path& file : files)
    if (!file.empty()) wanted.push_back(file);
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    for (const fs::path& input : inputs)
      if (!input.empty() && same_file(wanted[i], input))
        fail(ErrorKind::usage, "{}: is the input {}; choose another file to write", wanted[i].string(),
             input.string());
    for (std::size_t j = 0; j < i; ++j)
      if (resolved_path(wanted[i]) == resolved_path(wanted[j]))
        fail(ErrorKind::usage, "{}: two results cannot go to one file", wanted[i].string());
  }
  check_replaceable(wanted);
}

}  // namespace

void check_output_files(const Paths& files, const Paths& inputs) {
  check_files(files, inputs);
  for (const fs::path& file : files) {
    if (file.empty()) continue;
    if (is_folder(file)) fail(ErrorKind::data, "{}: is a folder, cannot write a file", file.string());
    const fs::path folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
    if (access(folder.c_str(), W_OK | X_OK) != 0)
      fail(ErrorKind::data, "{}: cannot write: {}", file.string(), std::strerror(errno));
  }
}

void check_apart(const fs::path& folder, const Paths& data) {
  for (const fs::path& input : data) {
    if (input.empty()) continue;
    if (lies_in(folder, input) && is_data_folder(folder, input))
      fail(ErrorKind::usage,
           "{}: is a folder of images or cameras of the data {}; choose another output folder",
           folder.string(), input.string());
    const char* how = same_file(folder, input) ? "is" : lies_in(input, folder) ? "holds" : nullptr;
    if (how)
      fail(ErrorKind::usage, "{}: {} the data ({}); choose an output folder apart from them", folder.string(),
           how, input.string());
  }
}

std::unique_ptr<FolderLock> take_folder(const fs::path& folder, const Paths& names, const Paths& data) {
  if (folder.empty()) return nullptr;
  if (path_exists(folder) && !is_folder(folder))
    fail(ErrorKind::usage, "{}: is not a folder", folder.string());
  check_apart(folder, data);
  Paths files;
  for (const fs::path& name : names) files.push_back(folder / name);
  check_files(files, data);
  return std::make_unique<FolderLock>(folder);
}

}  // namespace ubs
