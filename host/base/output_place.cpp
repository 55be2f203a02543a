// SPDX-License-Identifier: Apache-2.0
#include "host/base/output_place.hpp"

#include <unistd.h>

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
    const char* how = same_file(folder, input) ? "is"
                      : lies_in(folder, input) ? "lies in"
                      : lies_in(input, folder) ? "holds"
                                               : nullptr;
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
