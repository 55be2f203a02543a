// SPDX-License-Identifier: Apache-2.0
// Where files are kept that can be made again: $XDG_CACHE_HOME/ubs, else ~/.cache/ubs.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>

namespace ubs {

// The environment variable `override_name` may name another folder. Empty when there is none to name; not
// made.
std::filesystem::path cache_folder(const char* override_name);

// FNV-1a, 64 bit: names a file, no more. `seed` other than the default gives an independent name.
std::uint64_t name_hash(std::string_view text, std::uint64_t seed = 0xcbf29ce484222325u);

}  // namespace ubs
