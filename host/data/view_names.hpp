// SPDX-License-Identifier: Apache-2.0
// These functions make the names of views safe and unique. Commands write a file for each view, named after
// it, but the names come from untrusted data: JSON files, COLMAP models, packed files. load_dataset passes
// every view of every layout through these functions, so that "<name>.png" in a folder is a file in that
// folder, and a different file for each view.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

// Returns `name` with %HH instead of each byte that file names cannot contain on every system: separators,
// control characters and <>:"|?*. The first byte is also replaced in names that consist only of dots and in
// Windows device names (CON, LPT1, ...). A name of more than 180 bytes is shortened to its start, "~" and a
// hash of the whole name. An empty name becomes "view". The name need not be UTF-8. A safe name is returned
// unchanged.
std::string safe_file_name(std::string_view name);

// Applies safe_file_name to every view, then renames later views with an equal name to name_2, name_3, ...
// Names count as equal if they differ only in the case of the letters A to Z. Names with the suffixes _alpha
// and _depth, which `render` adds, count as used too.
void settle_view_names(std::vector<View>& views);

// Like settle_view_names, for views that are grouped by image: counts[i] consecutive views belong to image i.
// The names of images are made unique first, so that the names of all views of one image start with the same
// View::part_of.
void settle_image_names(std::vector<View>& views, const std::vector<std::size_t>& counts);

}  // namespace ubs
