// SPDX-License-Identifier: Apache-2.0
// These file system functions throw Error(data) with the path and the reason if they fail. The functions of
// std::filesystem, called without an error_code, throw a different exception. With them, mistakes of the
// user, such as a name that is too long or a loop of symbolic links, would be reported as internal errors.
#pragma once

#include <cstdint>
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
// Returns whether two paths refer to the same file. Returns false if one of them does not exist.
bool same_file(const std::filesystem::path& a, const std::filesystem::path& b);

// Returns the size of a file [bytes].
std::uint64_t file_bytes(const std::filesystem::path& path);
// Returns the entries of a folder, sorted.
std::vector<std::filesystem::path> folder_entries(const std::filesystem::path& folder);

// Creates a folder and all missing folders above it, and waits until they are on the disk. Does nothing if
// the folder exists already. Throws Error(data) if the path is a file.
void make_folders(const std::filesystem::path& folder);
// Removes a file or an empty folder. Does nothing if the path does not exist.
void remove_path(const std::filesystem::path& path);
// Removes a file, or a folder with everything in it. Does nothing if the path does not exist.
void remove_tree(const std::filesystem::path& path);
// Renames a file or a folder. Replaces an existing file at the path `to`.
void rename_path(const std::filesystem::path& from, const std::filesystem::path& to);

// Waits until the names of the files in the folder are on the disk.
void sync_folder(const std::filesystem::path& folder);

// Returns the folder that contains a file. Returns "." if the path of the file is only a name.
std::filesystem::path folder_of(const std::filesystem::path& file);
std::filesystem::path absolute_path(const std::filesystem::path& path);
// Returns an absolute path without "." and "..", with all links resolved as far as the path exists.
std::filesystem::path resolved_path(const std::filesystem::path& path);
// Returns the extension in lower case, including the dot. Some programs write extensions in upper case.
std::string small_extension(const std::filesystem::path& file);
// Returns the folder of the system for temporary files, which is the value of the first of the variables
// TMPDIR, TMP, TEMP and TEMPDIR that is set, or /tmp if none is set.
std::filesystem::path temporary_folder();
// Returns the path of the executable of this process.
std::filesystem::path this_executable();

}  // namespace ubs
