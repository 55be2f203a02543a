// SPDX-License-Identifier: Apache-2.0
// Opens a data set of any known layout (docs/data.md): Blender / D-NeRF / PBR, nerfstudio, COLMAP,
// LLFF / N3V, packed file. Recognised by what the folder holds; every decision taken is in the report.
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
  std::array<double, 3> background{0, 0, 0};  // that transparent pixels are composited on
  bool load_images = true;                    // false: cameras only
  std::vector<std::string> image_splits;      // splits whose images are wanted; empty: all
  bool operator==(const DatasetOptions&) const = default;
};

struct Dataset {
  std::vector<Split> splits;  // train, test, val, as far as they exist; names of views: view_names.hpp
  std::optional<PointCloud> points;
  std::vector<std::array<double, 2>> depth_bounds;  // near, far of each training view, where stated
  std::array<double, 3> offset{0, 0, 0};            // world = local + offset; cameras and points are local
  LoadReport report;

  const Split* find(const std::string& split) const;
};

// What the loader of one layout delivers: world coordinates less `offset`, images as sources.
struct LoadedScene {
  std::vector<Split> splits;
  std::optional<WorldPoints> points;
  std::array<double, 3> offset{0, 0, 0};  // where the file has been made local before
  std::vector<std::array<double, 2>> depth_bounds;
  LoadReport report;
};

// Reads the points of a file that is in the folder by its name alone. Random ones are left out, with a note.
void take_points(const std::filesystem::path& file, LoadedScene& scene);

// By its name: png, jpg, ...
bool has_image_extension(const std::filesystem::path& path);
// The pictures in a folder, sorted, not below it; empty where there is no folder.
std::vector<std::filesystem::path> pictures_in(const std::filesystem::path& folder);

// Returns zip, tar, 7z and the like by the first bytes of a file; empty for anything else.
std::string archive_kind(const std::filesystem::path& file);

// The layout that `path` would be opened as; an error that lists what was looked for when there is none.
std::string detect_layout(const std::filesystem::path& path);

// Opens the data. The images of all splits stay sources, which are not decoded yet.
Dataset open_undecoded(const std::filesystem::path& path, const DatasetOptions& options);
// Decodes the images of options.image_splits if they fit the cache; otherwise they stay sources. Images of
// other splits are dropped.
void decode_images(Dataset& data, const DatasetOptions& options);
// open_undecoded() and decode_images().
Dataset load_dataset(const std::filesystem::path& path, const DatasetOptions& options = {});

LoadedScene load_nerfstudio(const std::filesystem::path& path, const DatasetOptions& options);
LoadedScene load_colmap(const std::filesystem::path& folder, const DatasetOptions& options);
LoadedScene load_llff(const std::filesystem::path& folder, const DatasetOptions& options);
// Background and reduction are those the file was packed with: asking for others is an error.
LoadedScene load_packed(const std::filesystem::path& file, const DatasetOptions& options);

// Error(usage) where one of --images, --test-every and --frames that is not among `used` has another value
// than usual and would be ignored. Not for packed files: settings of a run are used with a packed copy of its
// data.
void refuse_unused(const DatasetOptions& options, std::string_view layout, std::string_view used);

// Moves cameras from coordinates relative to `from` to coordinates relative to `to` (both in the world).
void rebase(std::vector<View>& views, const std::array<double, 3>& from, const std::array<double, 3>& to);

}  // namespace ubs
