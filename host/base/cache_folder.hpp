// SPDX-License-Identifier: Apache-2.0
// Where files are kept that can be made again: $XDG_CACHE_HOME/ubs, else ~/.cache/ubs. Compiled kernels are
// kept where they certainly can be written.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace ubs {

// The environment variable `override_name` may name another folder. Empty when there is none to name; not
// made, not tried.
std::filesystem::path cache_folder(const char* override_name);

// Why compiled code cannot be kept in the folder, in a few words ("No space left on device"); empty: it can.
// The folder is made where it is missing; a file is written to it and removed. Never throws.
std::string cache_defect(const std::filesystem::path& folder);

// <temporary folder>/ubs-<user number>, which nobody but this user can write to; empty where it cannot be
// had.
std::filesystem::path temporary_cache();

// A folder of this process alone, removed at its end, for a driver that writes compiled code even where none is to
// be kept; empty where it cannot be had.
std::filesystem::path process_cache();

// `wanted` where cache_defect() has nothing against it, else temporary_cache(), which is said on stderr, once
// for each folder wanted. Empty when there is neither; cache_defects() then says why. An empty `wanted`
// stands for an environment that names none.
std::filesystem::path usable_cache(const std::filesystem::path& wanted);

// What was found wrong with such folders so far: "/a/b: Permission denied; /tmp/ubs-7: ...".
std::string cache_defects();

// The folder of everything that is compiled and of what was learnt about compiled kernels: usable_cache() of
// $UBS_KERNEL_CACHE, else $XDG_CACHE_HOME/ubs, else ~/.cache/ubs. Exists and can be written. Empty with
// UBS_KERNEL_CACHE=off, and where there is no such folder: keep nothing then.
std::filesystem::path kernel_cache_folder();

// FNV-1a, 64 bit: names a file, no more. `seed` other than the default gives an independent name.
std::uint64_t name_hash(std::string_view text, std::uint64_t seed = 0xcbf29ce484222325u);

}  // namespace ubs
