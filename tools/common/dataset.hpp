// SPDX-License-Identifier: Apache-2.0
// Data folders as the subcommands want them: loaded with the settings, and checked against a model.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/spec/train_settings.hpp"

namespace ubs::tools {

enum class Images { load, skip };

// At least one view; with Images::skip every image is empty.
Split open_split(const std::filesystem::path& folder, const std::string& split, const TrainSettings& settings,
                 Images images);

// Throws Error(data) when the views bring fewer query values than N dimensions need.
void check_query(const Split& split, int dim);
// Throws Error(data) naming the first view without an image.
void require_images(const Split& split);

}  // namespace ubs::tools
