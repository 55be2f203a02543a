// SPDX-License-Identifier: Apache-2.0
// File system functions that fail in the same way as the rest of ubs: they throw Error(data) with the path
// and the reason. The functions of std::filesystem without an error_code throw a different exception. With
// them, mistakes of the user such as a name that is too long or a loop of symbolic links would end as an
// internal error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace ubs {

// These functions follow links. A path that does not exist, or whose name is too long for the file system, is
// neither a file nor a folder. They throw Error(data) if this cannot be determined: for a loop of links, or
// in a folder that may not be searched.
bool path_exists(const std::filesystem::path& path);
bool is_folder(const std::filesystem::path& path);
bool is_regular(const std::filesystem::path& path);
// Returns whether two names refer to the same file; false if one of them does not exist.
bool same_file(const std::filesystem::path& a, const std::filesystem::path& b);

std::uint64_t file_bytes(const std::filesystem::path& path);
// Returns the entries of a folder, sorted.
std::vector<std::filesystem::path> folder_entries(const std::filesystem::path& folder);

// Creates a folder and all folders above it. It is not an error if the folder exists already, unless it is a
// file. Returns when the folders are on the disk.
void make_folders(const std::filesystem::path& folder);
// Remove a file or an empty folder, or a folder with everything in it. It is not an error if the path does
// not exist.
void remove_path(const std::filesystem::path& path);
void remove_tree(const std::filesystem::path& path);
// Replaces a file of the new name.
void rename_path(const std::filesystem::path& from, const std::filesystem::path& to);

// Waits until the names in the folder are on the disk.
void sync_folder(const std::filesystem::path& folder);

// Returns the folder that a file is in: "." if its path does not contain one.
std::filesystem::path folder_of(const std::filesystem::path& file);
std::filesystem::path absolute_path(const std::filesystem::path& path);
// Returns an absolute path without "." and "..", with all links resolved as far as the path exists.
std::filesystem::path resolved_path(const std::filesystem::path& path);
// Returns the extension including the dot, in lower case, because other systems write it in upper case.
std::string small_extension(const std::filesystem::path& file);
std::filesystem::path temporary_folder();  // of the system: TMPDIR, or /tmp
std::filesystem::path this_executable();

}  // namespace ubs
