// SPDX-License-Identifier: Apache-2.0
// These functions make the names of views safe and unique. Commands write files that are named after the
// views, but the names come from untrusted data: JSON files, COLMAP models and packed files. load_dataset()
// passes every view of every layout through these functions, so that "<name>.png" in a folder is a file in
// that folder, and a different file for each view.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

// Returns `name` with %HH (the hexadecimal value) in place of each byte that some operating system does not
// allow in file names. These bytes are separators, control characters and <>:"|?*. The first byte is also
// replaced in names that consist only of dots, and in names of Windows devices (CON, LPT1, ...). A name of
// more than 180 bytes is shortened to its start, "~" and a hash of the whole name. An empty name becomes
// "view". The name need not be UTF-8.
std::string safe_file_name(std::string_view name);

// Applies safe_file_name() to the name of every view. If several views have the same name, the second and
// further ones are renamed to name_2, name_3, ... Names are treated as the same if they differ only in the
// case of the letters A to Z. A view must also not have the name of another view followed by _alpha or
// _depth, because `render` writes files with these names.
void make_view_names_unique(std::vector<View>& views);

// Makes the names of views unique, like make_view_names_unique(), for views that are grouped by image:
// counts[i] consecutive views belong to image i. The names of images are made unique first, so that the names
// of all views of one image start with the same View::part_of.
void settle_image_names(std::vector<View>& views, const std::vector<std::size_t>& counts);

}  // namespace ubs
