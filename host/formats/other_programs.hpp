// SPDX-License-Identifier: Apache-2.0
// other_programs() is the table of files and folders of other programs that ubs recognises but does not read
// as they are: cameras, splat files, and output folders of trainers. Messages use it to name the program, the
// file, and the way to convert it. A program needs only a row in this table.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ubs {

struct OtherProgram {
  enum class Content {
    moments,  // a folder with several models of cameras, of which one alone is not the whole scene
    cameras,  // a folder or a file with cameras that no layout of data folders reads
    splats,   // a folder or a file with splats that no reader of splat files reads
    models    // the output folder of a trainer, whose files are splat files that ubs reads
  };

  Content content;
  std::string_view program;
  // Paths relative to the folder, separated by blanks. All of them must exist. A '*' in a name matches any
  // text. Messages name the first file.
  std::string_view files;
  // Text that the first 64 KiB of the first file must contain. If it is empty, the contents do not matter.
  std::string_view key;
  // What the user can do. {0} is the path of the first file and {1} is the folder, as words of a shell
  // command. Empty for `models`, whose last file is used.
  std::string_view advice;
};

// Returns the whole table.
std::span<const OtherProgram> other_programs();

// Returns a sentence that names the program that a folder or a file belongs to, the file by which it was
// recognised, and the way to convert it. Returns an empty string for paths that no row of `content`
// describes.
std::string describe_other_program(const std::filesystem::path& path, OtherProgram::Content content);

// TrainerOutput contains the splat files in the output folder of a trainer.
struct TrainerOutput {
  std::string_view program;
  std::vector<std::filesystem::path> models;  // sorted by the numbers in their names
};
// Returns the splat files of the first row of Content::models that describes the folder. There are none if no
// row describes it.
TrainerOutput trainer_output(const std::filesystem::path& folder);

// Returns the paths in `folder` that a pattern matches (OtherProgram::files), sorted by the numbers in their
// names.
std::vector<std::filesystem::path> matching_paths(const std::filesystem::path& folder,
                                                  std::string_view pattern);
// Returns the first bytes of a file, at most 64 KiB. UTF-16 with a byte order mark is converted to UTF-8 as
// far as it is ASCII. Returns an empty string if the file cannot be read.
std::string start_of_file(const std::filesystem::path& path);

}  // namespace ubs
