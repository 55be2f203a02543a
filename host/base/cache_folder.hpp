// SPDX-License-Identifier: Apache-2.0
// Folders for cached files, which can be created again at any time: $XDG_CACHE_HOME/ubs, or ~/.cache/ubs. For
// compiled kernels, the folder is checked to be writable.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace ubs {

// Returns the cache folder. The environment variable `override_name` may select another one. Returns an empty
// path if no folder is known. The folder is neither created nor checked.
std::filesystem::path cache_folder(const char* override_name);

// Returns why compiled code cannot be stored in the folder, in a few words ("No space left on device"), or an
// empty string if it can. Creates the folder if it is missing; writes a file to it and removes it again.
// Never throws.
std::string cache_defect(const std::filesystem::path& folder);

// Returns <temporary folder>/ubs-<user number>, which only this user can write to, or an empty path if it
// cannot be created.
std::filesystem::path temporary_cache();

// Returns a folder that only this process uses and that is removed at its end. It is for a driver that writes
// compiled code even if none should be kept. Returns an empty path if it cannot be created.
std::filesystem::path process_cache();

// Returns `wanted` if cache_defect() finds no problem with it. Otherwise returns temporary_cache() and prints
// a message on stderr, once for each wanted folder. Returns an empty path if neither can be used;
// cache_defects() then gives the reasons. An empty `wanted` means that the environment does not specify a
// folder.
std::filesystem::path usable_cache(const std::filesystem::path& wanted);

// Returns the problems found with such folders so far: "/a/b: Permission denied; /tmp/ubs-7: ...".
std::string cache_defects();

// Returns the folder for compiled kernels and for data about them: the result of usable_cache() for
// $UBS_KERNEL_CACHE, $XDG_CACHE_HOME/ubs or ~/.cache/ubs. It exists and is writable. Returns an empty path
// with UBS_KERNEL_CACHE=off, or if there is no usable folder; then nothing is cached.
std::filesystem::path kernel_cache_folder();

// Returns a 64-bit FNV-1a hash, for the names of files. A different `seed` gives an independent hash.
std::uint64_t name_hash(std::string_view text, std::uint64_t seed = 0xcbf29ce484222325u);

}  // namespace ubs
