// SPDX-License-Identifier: Apache-2.0
// Where a command may write, checked before it works: files that exist are replaced only with --overwrite,
// and never what the command reads.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <vector>

#include "host/base/folder_lock.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::tools {

using Paths = std::vector<std::filesystem::path>;

void add_overwrite_option(CLI::App& app, bool& overwrite);

// For files that are written one by one. Throws Error(usage) if one of them is one of the inputs, by whatever
// name or link, is named twice, or exists and `overwrite` is false; Error(data) if it is not an ordinary
// file, or if nothing can be written to its folder. Empty paths are left out.
void check_output_files(const Paths& files, const Paths& inputs, bool overwrite);

// Only the last of these checks: Error(usage) for files that exist, Error(data) for what is not an ordinary
// file.
void check_free(const Paths& files, bool overwrite);

// Throws Error(usage) if the folder is one of the `data` or holds it, or is a folder inside it that loaders
// read by its name or that has cameras. Data are folders or files.
void check_apart(const std::filesystem::path& folder, const Paths& data);
// Throws Error(usage) if images of the views are directly in the folder.
void check_apart_from_images(const std::filesystem::path& folder, const Split& views);

// For files of known `names` in a folder. Calls check_apart() and checks the files as check_output_files()
// does, with the data as inputs. Then makes the folder if it is missing, and locks it against other
// processes. Returns null for an empty path.
std::unique_ptr<FolderLock> take_folder(const std::filesystem::path& folder, const Paths& names,
                                        const Paths& data, bool overwrite);

}  // namespace ubs::tools
