// SPDX-License-Identifier: Apache-2.0
// See named_files.hpp.
#include "host/dataset/named_files.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/load_dataset.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kKindNames[] = {"images", "masks", "files of points"};

bool is_mask_folder(std::string_view folded) { return folded == "mask" || folded == "masks"; }

// Returns whether one of the folders of a path is a mask folder. `parts` are the folded components of the
// path; the last component is the name of the file.
bool below_mask_folder(const std::vector<std::string>& parts) {
  return std::any_of(parts.begin(), parts.end() - 1, [](const std::string& p) { return is_mask_folder(p); });
}

std::string parent_key(const std::string& name) {
  std::vector<std::string> parts = path_components(folded_name(name));
  if (!parts.empty()) parts.pop_back();
  return fmt::format("{}", fmt::join(parts, "/"));
}

bool is_absolute_name(const std::string& name) {
  return name.starts_with('/') || name.starts_with('\\') || (name.size() > 1 && name[1] == ':');
}

// Returns whether `path` is `folder` or below it. Compares only the names.
bool is_below(const fs::path& path, const fs::path& folder) {
  const fs::path relative = path.lexically_relative(folder);
  return !relative.empty() && *relative.begin() != "..";
}

// Claims collects the names that match one file. The file is used for a name that agrees with the whole path,
// if there is one, and otherwise for a name that agrees with the end of the path. If several names match
// equally well, the file is used for none of them.
struct Claims {
  std::set<std::string> whole, end;
  void add(const std::string& name, bool is_whole) { (is_whole ? whole : end).insert(name); }
  bool won_by(const std::string& name, bool is_whole) const {
    const std::set<std::string>& first = whole.empty() ? end : whole;
    return is_whole == !whole.empty() && first.size() == 1 && first.contains(name);
  }
};

// Returns the file with exactly this name, or an empty path. If the name of an image has no image extension,
// files with an appended extension are looked for first, because the names in published data sets lack the
// extension .png. The name "r_0.5" has no image extension either.
fs::path exact_file(const fs::path& base, const std::string& name, NamedFiles::Kind kind) {
  const fs::path path = (base / name).lexically_normal();
  if (kind == NamedFiles::Kind::image && !has_picture_extension(path.filename().string()))
    for (const char* extension : {".png", ".jpg", ".jpeg", ".exr", ".webp"})
      if (fs::path longer = fs::path(path).concat(extension); path_exists(longer)) return longer;
  return is_regular(path) ? path : fs::path();
}

// Lists `path` if it is a file, and all files below it except hidden ones if it is a folder. Links to folders
// are followed if they stay inside the data folder. Nothing is listed for links to nothing, for loops of
// links and for folders that cannot be read.
void list_below(const fs::path& path, const DataRoot& root, std::set<std::string>& visited,
                std::vector<fs::path>& files) {
  try {
    if (is_regular(path)) return files.push_back(path);
    if (!is_folder(path) || root.leads_outside(path)) return;
    if (!visited.insert(resolved_path(path).string()).second) return;
    for (const fs::path& entry : folder_entries(path))
      if (!entry.filename().string().starts_with('.')) list_below(entry, root, visited, files);
    // The search for files with similar names is optional. If the search fails, the caller reports that the
    // stated name does not exist.
  } catch (const std::exception&) {
  }
}

// Returns the name of the image that a mask belongs to, without the image extension: "a.jpg.png",
// "a_mask.png" and "a.png" are masks of "a".
std::string masked_name(std::string name) {
  while (has_picture_extension(name)) name.erase(name.rfind('.'));
  for (const std::string_view suffix : {"_masks", "_mask", "-mask", ".mask"})
    if (name.size() > suffix.size() && folded_name(name).ends_with(suffix))
      return name.substr(0, name.size() - suffix.size());
  return name;
}

}  // namespace

NamedFiles::NamedFiles(const DataRoot& root, fs::path folder)
    : root_(root), folder_(folder.empty() ? fs::path(".") : folder.lexically_normal()) {}

const NamedFiles::Listing& NamedFiles::listing(const fs::path& top) {
  const auto [at, is_new] = listings_.try_emplace(top.string());
  Listing& result = at->second;
  if (!is_new) return result;
  std::set<std::string> visited;
  list_below(top, root_, visited, result.files);
  for (const fs::path& file : result.files) result.index.add(file.lexically_relative(top).string());
  return result;
}

std::string NamedFiles::shown(const fs::path& file) const {
  return is_below(file, folder_) ? file.lexically_relative(folder_).string() : file.string();
}

void NamedFiles::count_other(Kind kind, const std::string& name, const fs::path& file) {
  Others& others = others_[kind];
  if (others.count++ == 0) others.example = fmt::format("'{}' for '{}'", shown(file), name);
}

bool NamedFiles::has_all(const fs::path& base, const std::vector<StatedName>& images) const {
  return std::ranges::all_of(
      images, [&](const StatedName& image) { return !exact_file(base, image.name, Kind::image).empty(); });
}

std::vector<fs::path> NamedFiles::find(const fs::path& stated_base, const std::vector<StatedName>& names,
                                       Kind kind, bool only_base) {
  const fs::path base = stated_base.empty() ? fs::path(".") : stated_base.lexically_normal();
  std::vector<fs::path> found(names.size());
  std::set<std::string> folders_found;  // stated folders in which one of their files was found
  std::vector<std::size_t> open;
  for (std::size_t i = 0; i < names.size(); ++i) {
    found[i] = exact_file(base, names[i].name, kind);
    if (found[i].empty()) {
      open.push_back(i);
      continue;
    }
    root_.check(found[i], names[i].where);
    use(found[i]);
    folders_found.insert(parent_key(names[i].name));
  }
  if (!open.empty()) {
    const fs::path top = only_base || !is_below(base, folder_) ? base : folder_;
    const Listing& files = listing(top);
    const std::string prefix = base == top ? "" : base.lexically_relative(top).string() + "/";
    const std::vector<std::string> base_parts = path_components(folded_name(prefix));
    const auto in_base = [&](std::size_t number) {
      const std::vector<std::string>& parts = files.index.folded(number);
      return parts.size() > base_parts.size() &&
             std::equal(base_parts.begin(), base_parts.end(), parts.begin());
    };
    const auto of_kind = [&](std::size_t number) {
      return kind == Kind::points || below_mask_folder(files.index.folded(number)) == (kind == Kind::mask);
    };
    const auto any = [](std::size_t) { return true; };
    std::vector<std::optional<NameIndex::Match>> matches(names.size());
    for (const std::size_t i : open) {
      const std::string query = is_absolute_name(names[i].name) ? names[i].name : prefix + names[i].name;
      auto& match = matches[i];
      match = files.index.find(query, any);
      if (match && match->whole) {
        folders_found.insert(parent_key(names[i].name));
        continue;
      }
      match = files.index.find(query, [&](std::size_t n) { return of_kind(n) && in_base(n); });
      if (!match && folders_found.empty()) match = files.index.find(query, of_kind);
      if (!match && kind == Kind::mask) match = files.index.find(query, any);
    }
    std::map<std::size_t, Claims> claims;
    for (const std::size_t i : open) {
      auto& match = matches[i];
      if (match && !match->whole && folders_found.contains(parent_key(names[i].name))) match.reset();
      if (match) claims[match->number].add(names[i].name, match->whole);
    }
    for (const std::size_t i : open) {
      const auto& match = matches[i];
      if (!match || !claims[match->number].won_by(names[i].name, match->whole)) continue;
      const fs::path& file = files.files[match->number];
      if (used_.contains(file.lexically_normal().string()) || root_.leads_outside(file)) continue;
      found[i] = file;
    }
    for (const std::size_t i : open)
      if (!found[i].empty()) use(found[i]), count_other(kind, names[i].name, found[i]);
  }
  if (kind == Kind::image)
    for (const fs::path& file : found)
      if (!file.empty()) image_folders_.insert(file.parent_path().string());
  return found;
}

std::vector<fs::path> NamedFiles::find_masks(const std::vector<StatedName>& images) {
  std::vector<fs::path> found(images.size()), folders;
  for (const fs::path& entry : folder_entries(folder_))
    if (is_mask_folder(folded_name(entry.filename().string())) && is_folder(entry)) folders.push_back(entry);
  if (folders.empty()) return found;
  std::vector<std::size_t> open;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const std::string& name = images[i].name;
    // If the name of the image leads out of the mask folder, the search could find the image itself as its
    // own mask, so such names are not used.
    const std::string plain = fs::path(name).lexically_normal().string();
    const bool outside = plain.starts_with('/') || plain.starts_with("../");
    for (const fs::path& folder : folders) {
      const fs::path kept = folder / name;
      for (const fs::path& candidate :
           {fs::path(kept).concat(".png"), kept, fs::path(kept).replace_extension(".png")})
        if (found[i].empty() && !outside && path_exists(candidate))
          found[i] = root_.check(candidate, images[i].where);
    }
    if (found[i].empty())
      open.push_back(i);
    else
      use(found[i]);
  }
  if (open.empty()) return found;
  NameIndex index;
  std::vector<fs::path> files;
  for (const fs::path& folder : folders)
    for (const fs::path& file : listing(folder).files) {
      if (!has_picture_extension(file.filename().string()) ||
          used_.contains(file.lexically_normal().string()))
        continue;
      const fs::path relative = file.lexically_relative(folder);
      index.add((relative.parent_path() / masked_name(relative.filename().string())).string());
      files.push_back(file);
    }
  std::map<std::size_t, Claims> claims;
  std::vector<std::optional<NameIndex::Match>> matches(images.size());
  for (const std::size_t i : open) {
    matches[i] = index.find(images[i].name, [](std::size_t) { return true; });
    if (matches[i]) claims[matches[i]->number].add(images[i].name, matches[i]->whole);
  }
  for (const std::size_t i : open) {
    const auto& match = matches[i];
    if (!match || !claims[match->number].won_by(images[i].name, match->whole)) continue;
    if (root_.leads_outside(files[match->number])) continue;
    found[i] = files[match->number];
    use(found[i]);
    count_other(Kind::mask, images[i].name, found[i]);
  }
  return found;
}

std::string NamedFiles::missing(const fs::path& stated_base, const std::string& name) {
  const fs::path base = stated_base.empty() ? fs::path(".") : stated_base;
  const fs::path top = is_below(base.lexically_normal(), folder_) ? folder_ : base.lexically_normal();
  for (const char* extension : {"", ".png", ".jpg", ".jpeg", ".exr", ".webp"})
    if (const fs::path path = (base / name).concat(extension).lexically_normal(); is_dead_link(path))
      return fmt::format("'{}' is a symbolic link to a file that does not exist", path.string());
  const NameIndex& index = listing(top).index;
  std::string text = fmt::format(
      "'{}' does not exist (searched in {}, then below {} for a file whose path ends in the same way)", name,
      base.string(), top.string());
  if (const std::size_t alike = index.count_alike(name); alike > 1)
    return text +
           fmt::format("; {} files have this name, and none of them matches better than the others", alike);
  const std::string nearest = index.nearest(name);
  return text + (nearest.empty() ? "; no file there has a similar name"
                                 : fmt::format("; the nearest name there is '{}'", nearest));
}

void NamedFiles::report(LoadReport& report) {
  for (const auto& [kind, others] : others_)
    report.note_difference(fmt::format("{} {} found under slightly different names, such as {}", others.count,
                                       kKindNames[static_cast<int>(kind)], others.example));
  const auto note_unused = [&](const std::vector<fs::path>& files, const std::string& why) {
    std::size_t unused = 0;
    std::string first;
    for (const fs::path& file : files) {
      if (!has_picture_extension(file.filename().string()) ||
          used_.contains(file.lexically_normal().string()))
        continue;
      if (unused++ == 0) first = shown(file);
    }
    if (unused > 0)
      report.note_difference(fmt::format("{} {} (the first: '{}'): not used", unused, why, first));
  };
  for (const std::string& folder : image_folders_)
    if (is_folder(folder))
      note_unused(pictures_in(folder), fmt::format("images in '{}' belong to no camera", shown(folder)));
  if (!is_folder(folder_)) return;
  for (const fs::path& entry : folder_entries(folder_))
    if (is_mask_folder(folded_name(entry.filename().string())) && is_folder(entry))
      note_unused(listing(entry).files, fmt::format("masks in '{}' belong to no image", shown(entry)));
}

}  // namespace ubs
