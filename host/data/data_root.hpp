// SPDX-License-Identifier: Apache-2.0
// Where a data set may be read from. Its files name other files, and links lead anywhere: what lies outside
// of the folder that the user named is read only where the user allows it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace ubs {

class DataRoot {
 public:
  // `data`: the folder, or a file, whose folder then counts. It may be a link itself.
  DataRoot(const std::filesystem::path& data, bool allow_outside);
  // Another folder that the user named.
  void add(const std::filesystem::path& folder);

  // `path` itself. Throws Error(data) that starts with `where` and names --allow-outside when, all links
  // followed, it leads out of the folders. What is not there leads nowhere.
  const std::filesystem::path& check(const std::filesystem::path& path, const std::string& where = "") const;

  // Returns whether the path, all links followed, leads out of the folders.
  bool leads_outside(const std::filesystem::path& path) const;

 private:
  bool allow_outside_;
  std::vector<std::filesystem::path> roots_;  // absolute, without links
};

}  // namespace ubs
