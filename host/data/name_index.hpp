// SPDX-License-Identifier: Apache-2.0
// NameIndex finds a path that a data set states among paths that are there, where the two differ as paths of
// other machines and systems do: in capitals, in the Unicode form of accents (macOS decomposes them), in the
// separator of folders, in the extension of an image, and in the folders above. It touches no files.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace ubs {

// Returns the name with capitals made small, accents as separate characters (Unicode NFD) and backslashes as
// slashes: names that a person reads as the same have the same folded form.
std::string folded_name(std::string_view name);

// Returns the components of a path in which slashes and backslashes separate folders. A drive, "." and empty
// components are left out, ".." takes away the component before it.
std::vector<std::string> path_components(std::string_view path);

// Returns whether the extension is one of an image, also of formats that are not supported: the error names
// those.
bool has_picture_extension(std::string_view name);

class NameIndex {
 public:
  // `path` is relative and has slashes. Its number is the count of those added before.
  void add(const std::string& path);

  struct Match {
    std::size_t number = 0;
    bool whole = false;  // every component agrees; otherwise the end of the path alone
  };
  // Returns the path that agrees with `path` in the most components, counted from the end, if there is
  // exactly one such path. Among equals, first the extension decides and then the spelling. `accept` limits
  // the search to some numbers.
  template <typename Accept>
  std::optional<Match> find(std::string_view path, const Accept& accept) const {
    std::vector<std::size_t> candidates;
    for (const std::size_t number : same_stem(path))
      if (accept(number)) candidates.push_back(number);
    return best(path, candidates);
  }

  // Returns how many paths agree with `path` in the last component, without its extension.
  std::size_t count_alike(std::string_view path) const { return same_stem(path).size(); }
  // Returns the path whose last component needs the fewest changes of a letter; empty where none is near.
  std::string nearest(std::string_view path) const;

  const std::string& path(std::size_t number) const { return entries_[number].path; }
  const std::vector<std::string>& folded(std::size_t number) const { return entries_[number].folded; }
  std::size_t size() const { return entries_.size(); }

 private:
  struct Entry {
    std::string path;
    std::vector<std::string> folded;  // components
  };
  const std::vector<std::size_t>& same_stem(std::string_view path) const;
  std::optional<Match> best(std::string_view path, const std::vector<std::size_t>& candidates) const;

  std::vector<Entry> entries_;
  std::unordered_map<std::string, std::vector<std::size_t>> by_stem_;
};

}  // namespace ubs
