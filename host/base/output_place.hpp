// SPDX-License-Identifier: Apache-2.0
// Where a command may write, asked before it works: not onto what it reads, not among images of the data, not
// onto what it has not made (made_files.hpp).
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "host/base/folder_lock.hpp"

namespace ubs {

using Paths = std::vector<std::filesystem::path>;

// Throws Error(usage) when one of the files to be written is one of the inputs, by whatever name or link, is
// named twice, or exists and is not a result of the same command, and Error(data) when its folder is not
// there or nothing can be written to it: not hours later. Empty paths are left out.
void check_output_files(const Paths& files, const Paths& inputs);

// Throws Error(usage) when the folder is one of the `data` or holds it, or is a folder inside it with images
// or cameras of the data, by whatever name or link. Data are folders or files.
void check_apart(const std::filesystem::path& folder, const Paths& data);

// check_apart(), then the first part of check_output_files() for `names` in the folder with the data as
// inputs, then the folder itself: made where it is missing and held against other processes. Null for an
// empty path.
std::unique_ptr<FolderLock> take_folder(const std::filesystem::path& folder, const Paths& names,
                                        const Paths& data = {});

}  // namespace ubs
