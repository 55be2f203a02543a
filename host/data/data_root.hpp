// SPDX-License-Identifier: Apache-2.0
// DataRoot checks which files a data set may read. Files of a data set name other files, and symbolic links
// may lead to any place. Files outside of the folder that the user named are read only if the user allows it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace ubs {

class DataRoot {
 public:
  // `data`: the folder, or a file in it. It may itself be a link.
  DataRoot(const std::filesystem::path& data, bool allow_outside);
  // Also allows another folder that the user named.
  void add(const std::filesystem::path& folder);

  // Returns `path` unchanged. Throws Error(data) if the path, after resolving all links, is outside of the
  // allowed folders; the message starts with `where` and names --allow-outside. A path that does not exist is
  // accepted.
  const std::filesystem::path& check(const std::filesystem::path& path, const std::string& where = "") const;

  // Returns whether the path, after resolving all links, is outside of the allowed folders.
  bool leads_outside(const std::filesystem::path& path) const;

 private:
  bool allow_outside_;
  std::vector<std::filesystem::path> roots_;  // absolute, without links
};

}  // namespace ubs
