// SPDX-License-Identifier: Apache-2.0
// These functions open data folders for commands and for the library. They read the data as the settings
// specify, and check that the views fit a model.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "host/dataset/load_dataset.hpp"
#include "host/scene/dataset.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {

enum class Images { load, skip };

// Loads a data folder of any supported layout. Loads the images of the splits in `image_splits`, or of all
// splits if the list is empty. With Images::skip, loads no images.
Dataset open_dataset(const std::filesystem::path& folder, const std::vector<std::string>& image_splits,
                     const TrainSettings& settings, Images images);

// OpenedData is a data set that was opened once, so that later calls need not read the files again. The
// images of all splits are only decoded when they are needed.
struct OpenedData {
  std::filesystem::path folder;
  DatasetOptions reading;  // options that the data set was opened with
  Dataset data;
};
OpenedData open_undecoded(const std::filesystem::path& folder, const TrainSettings& settings);
// Returns the same data set as open_dataset() above. Does not read the files again if `opened` is the data
// set of the same folder and was opened with the same options.
Dataset open_dataset(const std::optional<OpenedData>& opened, const std::filesystem::path& folder,
                     const std::vector<std::string>& image_splits, const TrainSettings& settings,
                     Images images);

// Moves the split out of the data set and returns it. If it is missing or empty, throws Error(data) with a
// list of the available splits.
Split take_split(Dataset& data, const std::string& split);
// The same, but does not move it.
const Split& need_split(const Dataset& data, const std::string& split);

// Logs a warning for each kind of item of the data that the loader skipped, for example images without a
// camera.
void warn_skipped(const LoadReport& report);

// Opens a data set and returns one of its splits, which has at least one view. Also logs warnings about
// skipped data. With Images::skip, the views have no images. The returned cameras are in the coordinates of a
// model: a position in the world is the position in the model plus `offset`. If settings.run_cameras is the
// folder of a run, the cameras that this run has refined are used.
Split open_split_for(const std::array<double, 3>& offset, const std::filesystem::path& folder,
                     const std::string& split, const TrainSettings& settings, Images images,
                     const std::optional<OpenedData>& opened = {});

// Returns how many query values besides direction and time N dimensions need.
std::size_t further_queries(int dim);
// Throws Error(data) if the views have fewer query values than N dimensions need.
void check_query(const Split& split, int dim);
// Throws Error(data) if a view has no image. The message contains the name of the first such view.
void require_images(const Split& split);

}  // namespace ubs
