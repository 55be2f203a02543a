// SPDX-License-Identifier: Apache-2.0
// These functions choose folders for cached files, which can be created again at any time. The default folder
// is $XDG_CACHE_HOME/ubs, or ~/.cache/ubs if XDG_CACHE_HOME is not set. A folder for compiled kernels is only
// used if files can be written to it and the file system allows running code from it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace ubs {

// Returns the value of the environment variable `override_name`, if it is set, and otherwise the default
// folder. Returns an empty path if HOME is not set either. The folder is neither created nor checked.
std::filesystem::path cache_folder(const char* override_name);

// Returns the reason why compiled code cannot be stored in the folder, for example "No space left on device",
// or an empty string if it can be stored. Creates the folder if it is missing, writes a file to it, and
// removes the file again. Never throws.
std::string cache_defect(const std::filesystem::path& folder);

// Returns the folder ubs-<user number>, which is in the folder of the system for temporary files
// (temporary_folder.hpp), or in /tmp if that folder does not exist. Only this user can access it. Returns an
// empty path if the folder cannot be created or used.
std::filesystem::path temporary_cache();

// Returns a folder that only this process uses, and that is removed when the process ends. Some drivers
// always write compiled code to files. They use this folder if no compiled code is to be kept. Returns an
// empty path if the folder cannot be created.
std::filesystem::path process_cache();

// Returns `wanted` if cache_defect() finds no problem with it. Otherwise returns temporary_cache() and logs a
// warning, once for each wanted folder. Returns an empty path if neither folder can be used; then
// cache_defects() returns the reasons. Callers pass an empty `wanted` if the environment does not specify a
// folder.
std::filesystem::path usable_cache(const std::filesystem::path& wanted);

// Returns the problems that have been found with cache folders so far, for example "/a/b: Permission denied;
// /tmp/ubs-7: ...".
std::string cache_defects();

// Returns the folder for compiled kernels and for data about them. This is the result of usable_cache() for
// $UBS_KERNEL_CACHE, or for the default folder if this variable is not set. The returned folder exists and is
// writable. Returns an empty path if UBS_KERNEL_CACHE is "off", or if no folder is usable; then nothing is
// cached.
std::filesystem::path kernel_cache_folder();

// Returns a 64-bit FNV-1a hash of the text, for use in file names. Another `seed` gives an independent hash.
std::uint64_t name_hash(std::string_view text, std::uint64_t seed = 0xcbf29ce484222325u);

}  // namespace ubs
