// SPDX-License-Identifier: Apache-2.0
// NameIndex finds a file whose path a data set states, even if the stated path differs from the actual path.
// Such differences are common when data move between machines and systems. They can be in upper and lower
// case, in the Unicode form of accents (macOS decomposes them), in the folder separator, in the image
// extension, or in the parent folders. NameIndex only compares paths and does not access files.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace ubs {

// Returns the name in lower case, with accents as separate characters (Unicode NFD) and with slashes instead
// of backslashes. So names that differ only in these respects have the same folded form. This works for
// Latin, Greek, Cyrillic, Japanese and Korean letters; other characters are copied.
std::string folded_name(std::string_view name);

// Returns the components of a path; slashes and backslashes separate folders. Drives, "." and empty
// components are skipped, and ".." removes the component before it.
std::vector<std::string> path_components(std::string_view path);

// Returns whether the file name has the extension of an image format. This includes formats that are not
// supported, so that the file is found and the error message can name its format.
bool has_picture_extension(std::string_view name);

class NameIndex {
 public:
  // Adds a path, which must be relative and separate its folders by slashes. Its number is the number of
  // paths that were added before.
  void add(const std::string& path);

  struct Match {
    std::size_t number = 0;
    bool whole = false;  // true if all components agree, false if only the end of the path agrees
  };
  // Searches the paths whose last component equals that of `path`, except for the image extension. Returns
  // the path that agrees with `path` in the largest number of components, counted from the end. Among paths
  // with the same number of such components, paths with the same extension are preferred, then paths with the
  // same spelling of the last component. Returns nullopt if several paths agree equally well, or if there is
  // none. Only paths for whose number accept() returns true are considered.
  template <typename Accept>
  std::optional<Match> find(std::string_view path, const Accept& accept) const {
    std::vector<std::size_t> candidates;
    for (const std::size_t number : same_stem(path))
      if (accept(number)) candidates.push_back(number);
    return best(path, candidates);
  }

  // Returns the number of paths whose last component, without its extension, is that of `path`.
  std::size_t count_alike(std::string_view path) const { return same_stem(path).size(); }
  // Returns the path whose last component differs least from that of `path`, or an empty string if none is
  // similar.
  std::string nearest(std::string_view path) const;

  const std::string& path(std::size_t number) const { return entries_[number].path; }
  const std::vector<std::string>& folded(std::size_t number) const { return entries_[number].folded; }
  std::size_t size() const { return entries_.size(); }

 private:
  struct Entry {
    std::string path;
    std::vector<std::string> folded;  // components of the folded path
  };
  const std::vector<std::size_t>& same_stem(std::string_view path) const;
  std::optional<Match> best(std::string_view path, const std::vector<std::size_t>& candidates) const;

  std::vector<Entry> entries_;
  std::unordered_map<std::string, std::vector<std::size_t>> by_stem_;
};

}  // namespace ubs
