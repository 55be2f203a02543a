// SPDX-License-Identifier: Apache-2.0
// Names of views. Commands write a file for each view, named after it, while names come from data that nobody
// vouches for: JSON files, COLMAP models, packed files. load_dataset gives every view of every layout a name
// from here, so that "<name>.png" in a folder is a file in that folder, and another one for each view.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

// `name` with a %HH for each byte that file names cannot hold everywhere: separators, control characters and
// <>:"|?*; also the first byte of names of dots only and of the device names of Windows (CON, LPT1, ...). Of
// names beyond 180 bytes the start, "~" and a hash of the whole. "view" where nothing is left. UTF-8 is not
// required. A safe name is its own.
std::string safe_file_name(std::string_view name);

// safe_file_name of every view, then later views of a name that is taken become name_2, name_3, ... A name is
// also taken where only the case of letters A to Z differs, and with the suffixes _alpha and _depth that
// `render` adds.
void settle_view_names(std::vector<View>& views);

// settle_view_names for views of which those of one image stand together: counts[i] views are of image i. The
// names of images are settled first, so that views of one image keep the same beginning, View::part_of.
void settle_image_names(std::vector<View>& views, const std::vector<std::size_t>& counts);

}  // namespace ubs
