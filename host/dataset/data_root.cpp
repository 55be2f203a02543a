// SPDX-License-Identifier: Apache-2.0
// See data_root.hpp.
#include "host/dataset/data_root.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"

namespace ubs {

namespace fs = std::filesystem;

DataRoot::DataRoot(const fs::path& data, bool allow_outside) : allow_outside_(allow_outside) {
  if (allow_outside_) return;
  add(is_folder(data) ? data : data.has_parent_path() ? data.parent_path() : fs::path("."));
}

void DataRoot::add(const fs::path& folder) { roots_.push_back(resolved_path(folder)); }

bool DataRoot::leads_outside(const fs::path& path) const {
  if (allow_outside_ || !path_exists(path)) return false;
  const fs::path target = resolved_path(path);
  return std::ranges::none_of(
      roots_, [&](const fs::path& root) { return std::ranges::mismatch(root, target).in1 == root.end(); });
}

const fs::path& DataRoot::check(const fs::path& path, const std::string& where) const {
  if (!leads_outside(path)) return path;
  fail(ErrorKind::data,
       "{}{}{}: is {}, which is outside of the folder {}: pass --allow-outside to read it anyway", where,
       where.empty() ? "" : ": ", path.string(), resolved_path(path).string(), roots_.front().string());
}

}  // namespace ubs
