// SPDX-License-Identifier: Apache-2.0
// Questions to the file system, and changes of folders, that fail as everything here does: Error(data) with
// the path and the reason. The forms of std::filesystem without an error_code throw past that, and a name
// that is too long or a loop of symbolic links, a user's mistake, would end as an internal error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace ubs {

// Links are followed. What is not there, and what cannot be because its name is too long for the file system,
// is neither file nor folder. Error(data) where nobody can tell: a loop of links, a folder that may not be
// searched.
bool path_exists(const std::filesystem::path& path);
bool is_folder(const std::filesystem::path& path);
bool is_regular(const std::filesystem::path& path);
// Two names of one file; false when one of them is not there.
bool same_file(const std::filesystem::path& a, const std::filesystem::path& b);

std::uint64_t file_bytes(const std::filesystem::path& path);
// What is in a folder, sorted.
std::vector<std::filesystem::path> folder_entries(const std::filesystem::path& folder);

// With all folders above it; what is there already is no error, unless it is a file. On the disk afterwards.
void make_folders(const std::filesystem::path& folder);
// What is not there is no error.
void remove_path(const std::filesystem::path& path);
void remove_tree(const std::filesystem::path& path);

// Waits until the names in the folder are on the disk.
void sync_folder(const std::filesystem::path& folder);

// The folder that a file is in: "." where its path names none.
std::filesystem::path folder_of(const std::filesystem::path& file);
std::filesystem::path absolute_path(const std::filesystem::path& path);
// Absolute, without "." and "..", all links followed as far as the path exists.
std::filesystem::path resolved_path(const std::filesystem::path& path);
// With its dot, capitals made small: other systems write them.
std::string small_extension(const std::filesystem::path& file);
std::filesystem::path temporary_folder();  // of the system: TMPDIR, else /tmp
std::filesystem::path this_executable();

}  // namespace ubs
