// SPDX-License-Identifier: Apache-2.0
// DataRoot checks which files may be read when a data set is loaded. The files of a data set contain the
// names of other files, and symbolic links may lead to any place. Files outside of the folder that the user
// passed are read only if the user allows it. The files of the folder of a run are checked in the same way.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace ubs {

class DataRoot {
 public:
  // `data` is the data folder, or a file in it. The path may be a symbolic link. If `allow_outside` is true,
  // files in all folders may be read.
  DataRoot(const std::filesystem::path& data, bool allow_outside);
  // Also allows files of another folder, which the user passed.
  void add(const std::filesystem::path& folder);

  // Returns `path` unchanged. Throws Error(data) if the path, after resolving all links, is outside of the
  // allowed folders; the message starts with `where` and names --allow-outside. A path that does not exist is
  // accepted.
  const std::filesystem::path& check(const std::filesystem::path& path, const std::string& where = "") const;

  // Returns whether the path exists and, after resolving all links, is outside of the allowed folders.
  bool leads_outside(const std::filesystem::path& path) const;

 private:
  bool allow_outside_;
  std::vector<std::filesystem::path> roots_;  // absolute, without links
};

}  // namespace ubs
