// SPDX-License-Identifier: Apache-2.0
// Data folders as commands and the library want them: loaded with the settings, and checked against a model.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "host/data/load_dataset.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

enum class Images { load, skip };

// The folder in any known layout, with images of the splits named (empty list: of all).
Dataset open_dataset(const std::filesystem::path& folder, const std::vector<std::string>& image_splits,
                     const TrainSettings& settings, Images images);

// A data set that has been opened once, with the images of all splits as sources.
struct OpenedData {
  std::filesystem::path folder;
  DatasetOptions reading;  // as it was opened
  Dataset data;
};
OpenedData open_undecoded(const std::filesystem::path& folder, const TrainSettings& settings);
// Like open_dataset() above, but uses `opened` instead of the files if these settings read them the same way.
Dataset open_dataset(const std::optional<OpenedData>& opened, const std::filesystem::path& folder,
                     const std::vector<std::string>& image_splits, const TrainSettings& settings,
                     Images images);

// Moves the split out; an error that names the splits there are when it is missing or empty.
Split take_split(Dataset& data, const std::string& split);

// Skipped things as warnings.
void warn_skipped(const LoadReport& report);

// open_dataset, warn_skipped and take_split: at least one view, with Images::skip without its image. Cameras
// are relative to `offset` (of a model: world = model + offset), and as the run of the model has refined them
// where the settings name its folder.
Split open_split_for(const std::array<double, 3>& offset, const std::filesystem::path& folder,
                     const std::string& split, const TrainSettings& settings, Images images,
                     const std::optional<OpenedData>& opened = {});

// Throws Error(data) when the views bring fewer query values than N dimensions need.
void check_query(const Split& split, int dim);
// Throws Error(data) naming the first view without an image.
void require_images(const Split& split);

}  // namespace ubs
