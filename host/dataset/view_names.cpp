// SPDX-License-Identifier: Apache-2.0
// See view_names.hpp.
#include "host/dataset/view_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "host/base/cache_folder.hpp"
#include "host/base/text.hpp"

namespace ubs {
namespace {

// File systems usually allow names of 255 bytes. The remaining bytes are for suffixes and for the names of
// temporary files.
constexpr std::size_t kLongestName = 180;

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::string folded(std::string_view name) {
  std::string result(name);
  std::ranges::transform(result, result.begin(), lower);
  return result;
}

// Returns whether a name is that of a device. On Windows, files with these names are devices in every folder,
// regardless of the text after the first dot.
bool is_device(std::string_view name) {
  const std::string stem = folded(name.substr(0, name.find('.')));
  if (stem == "con" || stem == "prn" || stem == "aux" || stem == "nul") return true;
  return stem.size() == 4 && (stem.starts_with("com") || stem.starts_with("lpt")) && stem[3] >= '0' &&
         stem[3] <= '9';
}

std::string shortened(const std::string& name) {
  if (name.size() <= kLongestName) return name;
  const std::string end = fmt::format("~{:016x}", name_hash(name));
  std::size_t kept = kLongestName - end.size();
  // Do not cut the name inside of a UTF-8 character.
  while (kept > 0 && (static_cast<unsigned char>(name[kept]) & 0xc0) == 0x80) --kept;
  return name.substr(0, kept) + end;
}

constexpr const char* kSuffixes[] = {"", "_alpha", "_depth"};  // suffixes of the files of a view

}  // namespace

std::string safe_file_name(std::string_view name) {
  constexpr std::string_view kForbidden = "/\\<>:\"|?*\x7f";
  const bool first = name.find_first_not_of('.') == std::string_view::npos || is_device(name);
  std::string safe;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const auto byte = static_cast<unsigned char>(name[i]);
    if (byte < 0x20 || kForbidden.find(name[i]) != std::string_view::npos || (i == 0 && first))
      safe += fmt::format("%{:02X}", byte);
    else
      safe += name[i];
  }
  return safe.empty() ? "view" : shortened(safe);
}

void make_view_names_unique(std::vector<View>& views) {
  std::set<std::string> original, used;
  for (View& view : views) {
    view.name = safe_file_name(view.name);
    original.insert(folded(view.name));
  }
  const auto taken = [&](const std::string& name) {
    return std::ranges::any_of(kSuffixes, [&](const char* suffix) { return used.contains(name + suffix); });
  };
  // The last number that was tried for each name. Without it, many equal names would take quadratic time.
  std::map<std::string, int> copies;
  for (View& view : views) {
    std::string name = view.name;
    if (taken(folded(name))) {
      int& copy = copies.try_emplace(folded(view.name), 1).first->second;
      do {
        name = fmt::format("{}_{}", view.name, ++copy);
      } while (taken(folded(name)) || original.contains(folded(name)));
    }
    view.name = name;
    for (const char* suffix : kSuffixes) used.insert(folded(name) + suffix);
  }
}

void settle_image_names(std::vector<View>& views, const std::vector<std::size_t>& counts) {
  std::vector<View> images;
  std::size_t at = 0;
  for (const std::size_t count : counts) {
    images.emplace_back().name = views.at(at).part_of.empty() ? views[at].name : views[at].part_of;
    at += count;
  }
  make_view_names_unique(images);
  at = 0;
  for (std::size_t i = 0; i < counts.size(); ++i)
    for (std::size_t k = 0; k < counts[i]; ++k, ++at) {
      View& view = views[at];
      const std::string end = view.part_of.empty() ? "" : view.name.substr(view.part_of.size());
      view.name = images[i].name + end;
      if (!view.part_of.empty()) view.part_of = images[i].name;
    }
  make_view_names_unique(views);
}

}  // namespace ubs
