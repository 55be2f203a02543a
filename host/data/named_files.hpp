// SPDX-License-Identifier: Apache-2.0
// NamedFiles finds the files that a data set names: images, masks, points. All loaders use it, so that they
// find the same files and say the same. The exact name comes first. Where it fails, the folder of the data is
// listed once and a file is taken if exactly one fits (name_index.hpp); report() counts those in a note. It
// never leaves the data folder (data_root.hpp).
#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "host/data/data_root.hpp"
#include "host/data/load_report.hpp"
#include "host/data/name_index.hpp"

namespace ubs {

struct StatedName {
  std::string name;   // as the data state it
  std::string where;  // starts messages: the file and the frame
};

class NamedFiles {
 public:
  enum class Kind { image, mask, points };

  // Both must outlive this object. `folder` is the data folder.
  NamedFiles(const DataRoot& root, std::filesystem::path folder);

  // Returns whether all images are at their exact places. `base` is the folder that the names are relative
  // to.
  bool has_all(const std::filesystem::path& base, const std::vector<StatedName>& images) const;

  // Returns the file of each name, or an empty path. `base` is the folder that the names are relative to;
  // with `only_base` files elsewhere in the data folder do not count. A file in another folder than stated is
  // taken only where none of the names of that stated folder is there: a single missing image has been
  // deleted, and no reduced image or mask of the same name may take its place. Two names never get the same
  // file, unless the names are equal. Throws Error(data) for what leads out of the data folder.
  std::vector<std::filesystem::path> find(const std::filesystem::path& base,
                                          const std::vector<StatedName>& names, Kind kind,
                                          bool only_base = false);

  // Returns the mask of each image, or an empty path, from folders that are called "mask" or "masks". For
  // a.jpg, that is a.jpg.png, a.jpg, a.png, another extension, or a_mask with any extension.
  std::vector<std::filesystem::path> find_masks(const std::vector<StatedName>& images);

  // Says where a file that find() did not find was looked for, and the nearest name.
  std::string missing(const std::filesystem::path& base, const std::string& name);

  // Marks a file as used that the caller has found itself.
  void use(const std::filesystem::path& file) { used_.insert(file.lexically_normal().string()); }

  // Notes how many files were found by other than their exact names, how many pictures beside the used ones
  // belong to no camera, and how many masks to no image.
  void report(LoadReport& report);

 private:
  struct Listing {
    NameIndex index;
    std::vector<std::filesystem::path> files;
  };
  const Listing& listing(const std::filesystem::path& top);
  std::string shown(const std::filesystem::path& file) const;
  void count_other(Kind kind, const std::string& name, const std::filesystem::path& file);

  const DataRoot& root_;
  std::filesystem::path folder_;
  std::map<std::string, Listing> listings_;  // by the folder at their top
  std::set<std::string> used_;
  std::set<std::string> image_folders_;
  struct Others {
    std::size_t count = 0;
    std::string example;
  };
  std::map<Kind, Others> others_;
};

}  // namespace ubs
