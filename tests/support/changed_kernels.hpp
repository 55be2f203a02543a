// SPDX-License-Identifier: Apache-2.0
// changed_kernels() copies the kernel sources to another folder and replaces one text in one file. Tests set
// UBS_KERNEL_DIR to the copy, so that ubs compiles it.
#pragma once

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "host/base/file.hpp"
#include "tests/support/source_folder.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::test {

// Creates the copy inside `folder` and returns its path. Only one call per folder is possible.
inline std::filesystem::path changed_kernels(const TempFolder& folder, const std::string& file,
                                             const std::string& from, const std::string& to) {
  const std::filesystem::path copy = folder / "kernels";
  std::filesystem::copy(source_folder() / "kernels", copy, std::filesystem::copy_options::recursive);
  std::string text = read_text_file(copy / file);
  const std::size_t at = text.find(from);
  if (at == std::string::npos) throw std::logic_error("kernels/" + file + " has no text '" + from + "'");
  std::ofstream(copy / file, std::ios::trunc) << text.replace(at, from.size(), to);
  return copy;
}

}  // namespace ubs::test
