// SPDX-License-Identifier: Apache-2.0
// Opens a data set of any known layout (docs/data.md). The layout is recognised by the files in the folder.
// The report lists every decision that the loader made.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/data/load_report.hpp"
#include "host/data/world_points.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

struct DatasetOptions {
  ReadSettings read;
  std::array<double, 3> background{0, 0, 0};  // transparent pixels are composited on it
  bool load_images = true;                    // false: cameras only
  std::vector<std::string> image_splits;      // splits whose images are needed; empty: all
  bool operator==(const DatasetOptions&) const = default;
};

struct Dataset {
  std::vector<Split> splits;  // train, test and val, if present; view names: view_names.hpp
  std::optional<PointCloud> points;
  std::vector<std::array<double, 2>> depth_bounds;  // near, far of each training view, if the data state them
  std::array<double, 3> offset{0, 0, 0};            // world = local + offset; cameras and points are local
  LoadReport report;

  const Split* find(const std::string& split) const;
};

// Result of the loader of one layout: world coordinates minus `offset`, and images as sources.
struct LoadedScene {
  std::vector<Split> splits;
  std::optional<WorldPoints> points;
  std::array<double, 3> offset{0, 0, 0};  // not zero if the file already stores local coordinates
  std::vector<std::array<double, 2>> depth_bounds;
  LoadReport report;
};

// Reads points from a file that was found only by its name. If the points are random they are not used, and a
// note says so.
void take_points(const std::filesystem::path& file, LoadedScene& scene);

// Returns whether the file name has an image extension: png, jpg, ...
bool has_image_extension(const std::filesystem::path& path);
// Returns the image files in a folder, sorted, without those in subfolders. Returns nothing if the folder
// does not exist.
std::vector<std::filesystem::path> pictures_in(const std::filesystem::path& folder);
// Returns a text that says how to convert files that ubs does not read as images: HEIC and camera RAW
// photographs, and videos. For such a file, or for a folder with such files (also in its subfolder `images`),
// the text says what they are and contains the command that converts them to images. For other paths the text
// is empty.
std::string how_to_make_images(const std::filesystem::path& path);
// Returns the names of the files in the folder that hold cameras, such as transforms.json; "" if there are
// none.
std::string camera_files_in(const std::filesystem::path& folder);

// Returns the names of all layouts, which are the values of the setting `layout`, except auto.
std::vector<std::string_view> layout_names();
// Returns the data sets and programs that use the layouts of folders, for help texts: "Blender, D-NeRF, ...".
std::string layout_titles();
// Returns the layout that `path` would be opened as. Throws an error that lists the files looked for if no
// layout fits.
std::string detect_layout(const std::filesystem::path& path);

// Opens the data without decoding images: the images of all splits stay sources.
Dataset open_undecoded(const std::filesystem::path& path, const DatasetOptions& options);
// Decodes the images of options.image_splits if they fit the cache; otherwise they stay sources. Images of
// other splits are dropped.
void decode_images(Dataset& data, const DatasetOptions& options);
// Calls open_undecoded() and decode_images().
Dataset load_dataset(const std::filesystem::path& path, const DatasetOptions& options = {});

LoadedScene load_nerfstudio(const std::filesystem::path& path, const DatasetOptions& options);
LoadedScene load_colmap(const std::filesystem::path& folder, const DatasetOptions& options);
LoadedScene load_llff(const std::filesystem::path& folder, const DatasetOptions& options);
// The background and the reduction are those the file was packed with; requesting others is an error.
LoadedScene load_packed(const std::filesystem::path& file, const DatasetOptions& options);

// Throws Error(usage) if one of --images, --colmap-model, --test-every and --frames is not listed in `used`
// and has a value other than its default, because this value would be ignored. --test-every 0 and 8 are
// accepted.
// This function is not called for packed files, because the settings of a run are also used with a packed
// copy of its data.
void refuse_unused(const DatasetOptions& options, std::string_view layout, std::string_view used);

// Converts cameras from coordinates relative to `from` to coordinates relative to `to` (both in the world).
void rebase(std::vector<View>& views, const std::array<double, 3>& from, const std::array<double, 3>& to);

}  // namespace ubs
