// SPDX-License-Identifier: Apache-2.0
// These functions check where a command may write, before it starts to work. Existing files are only replaced
// with --overwrite, and inputs are never replaced.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/folder_lock.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::tools {

using Paths = std::vector<std::filesystem::path>;

void add_overwrite_option(CLI::App& app, bool& overwrite);

// Checks files that a command writes one by one. Throws Error(usage) if a file is one of the inputs (compared
// after resolving links), is listed twice, or exists while `overwrite` is false. Throws Error(data) if it is
// not an ordinary file, or if its folder is not writable. Empty paths are skipped.
void check_output_files(const Paths& files, const Paths& inputs, bool overwrite);

// Makes only two of these checks: throws Error(usage) for files that exist and Error(data) for files that are
// not ordinary files.
void check_free(const Paths& files, bool overwrite);

// `data` are folders or files. Throws Error(usage) if the folder is one of them or contains one of them. Also
// throws Error(usage) if the folder is inside the data, and contains cameras or has a name that loaders look
// for.
void check_outside(const std::filesystem::path& folder, const Paths& data);
// Throws Error(usage) if images of the views are directly in the folder.
void check_apart_from_images(const std::filesystem::path& folder, const Split& views);

// Throws Error(usage) if the file has the extension of another known format than the one that is written to
// it. `what` names the format in the message, such as "JSON". `extensions` are those of the format. An empty
// path is skipped, and names without an extension or with an unknown one are allowed.
void check_extension(const std::filesystem::path& file, const std::string& what,
                     const std::vector<std::string_view>& extensions);

// Prepares a folder for files with these `names`. Calls check_outside() and checks the files like
// check_output_files(), with the data as inputs. Then creates the folder if necessary and locks it against
// other processes. Returns null for an empty path.
std::unique_ptr<FolderLock> lock_output_folder(const std::filesystem::path& folder, const Paths& names,
                                               const Paths& data, bool overwrite);

}  // namespace ubs::tools
