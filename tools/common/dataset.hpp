// SPDX-License-Identifier: Apache-2.0
// Data sets as the subcommands want them: a folder or a packed file (host/data/packed.hpp), loaded with the
// settings, and checked against a model.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/scene/point_cloud.hpp"
#include "host/spec/train_settings.hpp"

namespace ubs::tools {

enum class Images { load, skip };

// At least one view; with Images::skip every image is empty. A packed file keeps the background and the
// reduction it was packed with: settings that ask for others are an error.
Split open_split(const std::filesystem::path& data, const std::string& split, const TrainSettings& settings,
                 Images images);
bool has_split(const std::filesystem::path& data, const std::string& split);
// The points that come with the data, to start from.
std::optional<PointCloud> open_points(const std::filesystem::path& data);

// Throws Error(data) when the views bring fewer query values than N dimensions need.
void check_query(const Split& split, int dim);
// Throws Error(data) naming the first view without an image.
void require_images(const Split& split);

}  // namespace ubs::tools
