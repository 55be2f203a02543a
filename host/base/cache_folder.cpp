// SPDX-License-Identifier: Apache-2.0
#include "host/base/cache_folder.hpp"

#include <cstdlib>
#include <string>

namespace ubs {
namespace {

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

}  // namespace

std::filesystem::path cache_folder(const char* override_name) {
  if (const std::string folder = environment(override_name); !folder.empty()) return folder;
  if (const std::string cache = environment("XDG_CACHE_HOME"); !cache.empty())
    return std::filesystem::path(cache) / "ubs";
  if (const std::string home = environment("HOME"); !home.empty())
    return std::filesystem::path(home) / ".cache" / "ubs";
  return {};
}

std::uint64_t name_hash(std::string_view text, std::uint64_t seed) {
  for (const unsigned char c : text) seed = (seed ^ c) * 0x100000001b3u;
  return seed;
}

}  // namespace ubs
