// SPDX-License-Identifier: Apache-2.0
// Opens data folders for commands and the library: loads them with the settings and checks them against a
// model.
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

// Loads the folder in any known layout, with images of the named splits (empty list: of all splits).
Dataset open_dataset(const std::filesystem::path& folder, const std::vector<std::string>& image_splits,
                     const TrainSettings& settings, Images images);

// A data set that was opened once. The images of all splits are sources that are decoded on demand.
struct OpenedData {
  std::filesystem::path folder;
  DatasetOptions reading;  // options that it was opened with
  Dataset data;
};
OpenedData open_undecoded(const std::filesystem::path& folder, const TrainSettings& settings);
// Like open_dataset() above, but uses `opened` instead of the files if these settings read them the same way.
Dataset open_dataset(const std::optional<OpenedData>& opened, const std::filesystem::path& folder,
                     const std::vector<std::string>& image_splits, const TrainSettings& settings,
                     Images images);

// Moves the split out. Throws an error that lists the available splits if it is missing or empty.
Split take_split(Dataset& data, const std::string& split);

// Prints a warning for everything that was skipped.
void warn_skipped(const LoadReport& report);

// Calls open_dataset, warn_skipped and take_split. Returns at least one view; with Images::skip, views have
// no images. Cameras are relative to `offset` (that of a model: world = model + offset). If the settings name
// the folder of a run, the cameras are those that the run has refined.
Split open_split_for(const std::array<double, 3>& offset, const std::filesystem::path& folder,
                     const std::string& split, const TrainSettings& settings, Images images,
                     const std::optional<OpenedData>& opened = {});

// Throws Error(data) if the views have fewer query values than N dimensions need.
void check_query(const Split& split, int dim);
// Throws Error(data) that names the first view without an image.
void require_images(const Split& split);

}  // namespace ubs
