// SPDX-License-Identifier: Apache-2.0
// load_dataset() opens a data set of any known layout (docs/data.md). The layout is recognised by the files
// in the folder. The report lists every decision that the loader made.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/dataset/world_points.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/load_report.hpp"
#include "host/settings/read_settings.hpp"

namespace ubs {

struct DatasetOptions {
  ReadSettings read;
  // Whether the user named the folder read.images, which then may be outside of the data folder. False if a
  // file of a run named it.
  bool images_from_user = true;
  std::array<double, 3> background{0, 0, 0};  // colour on which transparent pixels are composited
  bool load_images = true;                    // if false, views have cameras, but no images
  std::vector<std::string> image_splits;      // splits whose images are needed; empty for all splits
  bool operator==(const DatasetOptions&) const = default;
};

struct Dataset {
  std::vector<Split> splits;  // train, test and val, if present; for the names of views, see view_names.hpp
  std::optional<PointCloud> points;
  // Smallest and largest depth of the scene in each training view, if the data state them.
  std::vector<std::array<double, 2>> depth_bounds;
  // Positions of cameras and points are stored relative to this offset: world position = position + offset.
  std::array<double, 3> offset{0, 0, 0};
  LoadReport report;

  const Split* find(const std::string& split) const;
};

// LoadedScene is the result of the loader of one layout. Coordinates are world coordinates minus `offset`,
// and images are sources that are not decoded yet.
struct LoadedScene {
  std::vector<Split> splits;
  std::optional<WorldPoints> points;
  std::array<double, 3> offset{0, 0, 0};  // not zero if the file already stores local coordinates
  std::vector<std::array<double, 2>> depth_bounds;
  LoadReport report;
};

// Reads points from a file that was found only by its name. If the points are uniformly random, they are not
// used, and the report gets a note.
void take_points(const std::filesystem::path& file, LoadedScene& scene);
// Adds a note if points of a file were left out because they are not finite.
void note_not_finite(const WorldPoints& points, LoadReport& report);

// Adds a note for each split, except train, that contains images of the split train.
void note_shared_images(const std::vector<Split>& splits, LoadReport& report);

// Returns whether the file name has the extension of a supported image format, such as .png or .jpg.
bool has_image_extension(const std::filesystem::path& path);
// Returns the image files in a folder, sorted, without those in subfolders. Returns an empty list if the
// folder does not exist.
std::vector<std::filesystem::path> pictures_in(const std::filesystem::path& folder);
// Returns a string that says how to convert HEIC photographs, camera RAW photographs and videos, which ubs
// does not read as images. `path` is such a file, or a folder that contains such files itself or in its
// subfolder `images`. The string names the kind of the files and contains the command that converts them
// to images. For other paths it is empty.
std::string how_to_make_images(const std::filesystem::path& path);
// Returns the names of the files in the folder that contain cameras, such as transforms.json, separated by
// commas. The text is empty if there are no such files.
std::string camera_files_in(const std::filesystem::path& folder);

// LayoutText describes a layout in messages, help texts and docs/data.md.
struct LayoutText {
  std::string_view name;   // value of the setting `layout`
  std::string_view title;  // data sets and programs that use this layout
  std::string_view files;  // names of the files by which the layout is recognised
};
// Returns the texts of all layouts, in the order in which the layouts are tried. A test writes the list in
// docs/data.md with them.
std::vector<LayoutText> layout_texts();
// Returns the names of the data sets and programs whose folders can be read, for help texts.
std::string layout_titles();
// Returns the name of the layout of `path`. If no layout fits, throws an error whose message lists the files
// that were looked for.
std::string detect_layout(const std::filesystem::path& path);

// Opens the data without decoding images. The images of all splits remain sources (ImageSource).
Dataset open_undecoded(const std::filesystem::path& path, const DatasetOptions& options);
// Decodes the images of options.image_splits if all of them fit into the cache; otherwise they remain
// sources. The sources of other splits are removed.
void decode_images(Dataset& data, const DatasetOptions& options);
// Calls open_undecoded() and decode_images().
Dataset load_dataset(const std::filesystem::path& path, const DatasetOptions& options = {});

LoadedScene load_blender(const std::filesystem::path& folder, const DatasetOptions& options);
LoadedScene load_nerfstudio(const std::filesystem::path& path, const DatasetOptions& options);
LoadedScene load_colmap(const std::filesystem::path& folder, const DatasetOptions& options);
LoadedScene load_llff(const std::filesystem::path& folder, const DatasetOptions& options);
LoadedScene load_metashape(const std::filesystem::path& path, const DatasetOptions& options);
LoadedScene load_realitycapture(const std::filesystem::path& path, const DatasetOptions& options);
LoadedScene load_opensfm(const std::filesystem::path& path, const DatasetOptions& options);
LoadedScene load_bundler(const std::filesystem::path& path, const DatasetOptions& options);
LoadedScene load_polycam(const std::filesystem::path& folder, const DatasetOptions& options);
LoadedScene load_record3d(const std::filesystem::path& folder, const DatasetOptions& options);
// Return the names of the files with cameras, if `path` is a folder of this layout or such a file.
std::vector<std::string> metashape_files(const std::filesystem::path& path);
std::vector<std::string> realitycapture_files(const std::filesystem::path& path);
std::vector<std::string> opensfm_files(const std::filesystem::path& path);
std::vector<std::string> bundler_files(const std::filesystem::path& path);
std::vector<std::string> polycam_files(const std::filesystem::path& path);
std::vector<std::string> record3d_files(const std::filesystem::path& path);
// Loads a packed file. Its images were composited and reduced when the file was packed. Throws Error(data) if
// `options` has another background than the file and an image is not opaque. Also throws if the downscale
// factor of `options` is neither 1 nor that of the file.
LoadedScene load_packed(const std::filesystem::path& file, const DatasetOptions& options);

// Throws Error(usage) if one of --images, --colmap-model, --test-every and --frames is not listed in `used`
// and has a value other than its default, because this value would be ignored. --test-every 0 and
// --test-every 8 are always accepted. Packed files ignore these settings if they come from the record of a
// run, because a run may be repeated with a packed copy of its data. So for packed files, this function is
// called only with settings that the user has set.
void refuse_unused(const DatasetOptions& options, std::string_view layout, std::string_view used);

// Converts cameras from coordinates relative to `from` to coordinates relative to `to`. Both are positions in
// the world.
void rebase(std::vector<View>& views, const std::array<double, 3>& from, const std::array<double, 3>& to);

}  // namespace ubs
