// SPDX-License-Identifier: Apache-2.0
// NamedFiles finds the files whose names a data set states: images, masks and files of points. The loaders of
// data folders use it, so that they find the same files and print the same messages. NamedFiles first looks
// for the exact name. If there is no such file, it lists the data folder once and uses the file that matches
// best, if there is exactly one such file (name_index.hpp). report() adds a note with the number of files
// that were found in this way. Files outside of the data folder are used only if the user allows it
// (data_root.hpp).
#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "host/dataset/data_root.hpp"
#include "host/dataset/name_index.hpp"
#include "host/scene/load_report.hpp"

namespace ubs {

struct StatedName {
  std::string name;   // as stated in the data
  std::string where;  // start of error messages: the file and the frame that contain the name
};

class NamedFiles {
 public:
  enum class Kind { image, mask, points };

  // `folder` is the data folder. `root` must outlive this object.
  NamedFiles(const DataRoot& root, std::filesystem::path folder);

  // Returns whether all images exist at their exact paths. `base` is the folder that the names are relative
  // to.
  bool has_all(const std::filesystem::path& base, const std::vector<StatedName>& images) const;

  // Returns the file of each name, or an empty path. `base` is the folder that the names are relative to.
  // With `only_base`, files elsewhere in the data folder are not considered.
  // A file in another folder than stated is used only if none of the files that should be in the stated
  // folder was found there. If only some of these files are missing, they were probably deleted, and must not
  // be replaced by a reduced image or a mask of the same name. Two different names never get the same file.
  // Throws Error(data) if a file with exactly the stated path is outside of the data folder.
  std::vector<std::filesystem::path> find(const std::filesystem::path& base,
                                          const std::vector<StatedName>& names, Kind kind,
                                          bool only_base = false);

  // Returns the mask of each image, or an empty path. Searches in the subfolders "mask" and "masks" of the
  // data folder, whose names may contain capitals. The mask of a.jpg may be called a.jpg.png, a.jpg, a.png,
  // or "a" with another image extension. The name may also end in _mask, _masks, -mask or .mask before the
  // extension.
  std::vector<std::filesystem::path> find_masks(const std::vector<StatedName>& images);

  // Returns a string that says where a missing file was looked for, and the most similar name there.
  std::string missing(const std::filesystem::path& base, const std::string& name);

  // Marks a file as used. Callers need this only for files that they did not find with this class.
  void use(const std::filesystem::path& file) { used_.insert(file.lexically_normal().string()); }

  // Adds notes to the report: the number of files that were found under a name other than the exact one, the
  // number of unused images without a camera, and the number of masks without an image.
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
  std::map<std::string, Listing> listings_;  // the key is the top folder of the listing
  std::set<std::string> used_;
  std::set<std::string> image_folders_;
  struct Others {
    std::size_t count = 0;
    std::string example;
  };
  std::map<Kind, Others> others_;
};

}  // namespace ubs
