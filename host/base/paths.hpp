// SPDX-License-Identifier: Apache-2.0
// These functions do what the functions of std::filesystem do not: they treat a name that is too long as a
// name that does not exist, sort the entries of a folder, wait until new folders and names are on the disk,
// or return parts of a path in the form that ubs needs. If they fail, they throw Error(data) with the path
// and the reason, so that callers such as readers can catch Error to skip what they cannot read. For other
// operations, call std::filesystem itself: as_error() converts its exceptions (error.hpp).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace ubs {

// These three functions follow symbolic links. They return false for a path that does not exist, or whose
// name is too long for the file system. They throw Error(data) if they cannot determine the type of the path,
// because of a loop of links or because the user may not search a folder.
bool path_exists(const std::filesystem::path& path);
bool is_folder(const std::filesystem::path& path);
bool is_regular(const std::filesystem::path& path);
// Returns whether the path is a symbolic link to a file or folder that does not exist.
bool is_dead_link(const std::filesystem::path& path);

// Returns the entries of a folder, sorted.
std::vector<std::filesystem::path> folder_entries(const std::filesystem::path& folder);

// Creates a folder and all missing folders above it, and waits until they are on the disk. Does nothing if
// the folder exists already. Throws Error(data) if the path is a file.
void make_folders(const std::filesystem::path& folder);
// Waits until the names of the files in the folder are on the disk.
void sync_folder(const std::filesystem::path& folder);

// Returns the folder that contains a file. Returns "." if the path of the file is only a name.
std::filesystem::path folder_of(const std::filesystem::path& file);
// Returns an absolute path without "." and "..", with all links resolved as far as the path exists.
std::filesystem::path resolved_path(const std::filesystem::path& path);
// Returns the extension in lower case, including the dot. Some programs write extensions in upper case.
std::string small_extension(const std::filesystem::path& file);

}  // namespace ubs
