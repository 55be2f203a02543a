// SPDX-License-Identifier: Apache-2.0
// See load_dataset.hpp.
#include "host/dataset/load_dataset.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <unordered_set>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/parallel.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/dataset/blender.hpp"
#include "host/dataset/colmap.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/packed.hpp"
#include "host/dataset/split_views.hpp"
#include "host/dataset/view_names.hpp"
#include "host/formats/other_programs.hpp"
#include "host/formats/splat_file.hpp"
#include "host/scene/extent.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

// If the cameras are farther from the origin than this multiple of the scene extent, coordinates are stored
// relative to an offset. At this distance, rounding to float32 changes a coordinate by up to 1.5e-5 of the
// extent, which is about a fiftieth of a pixel in an image.
constexpr double kFarFromOrigin = 256;

constexpr const char* kSplits[] = {"train", "test", "val"};

std::array<double, 3> mean_position(const Split& split) {
  std::array<double, 3> mean{};
  for (const View& view : split.views) {
    const std::array<double, 3> c = view.camera.centre();
    for (std::size_t k = 0; k < 3; ++k) mean[k] += c[k] / static_cast<double>(split.views.size());
  }
  return mean;
}

double length_of(const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); }

// Cameras are treated as being at the same position if their positions differ only by rounding errors of the
// files. The assumed rounding error is kPositionRounding times the distance from the origin. It is at least
// kLeastRounding, because this product would be too small near the origin. If the data are in kilometres,
// kLeastRounding is a hundredth of a millimetre. The assumed rounding error is at most kMostRounding, because
// georeferenced data, which are far from the origin, have enough digits to distinguish positions that are
// farther apart than this.
constexpr double kPositionRounding = 1e-7, kLeastRounding = 1e-8, kMostRounding = 1e-4;

// Returns whether all cameras have the same position. This must be decided before the offset is subtracted:
// afterwards, the positions may consist only of rounding errors, and at_one_place() would treat them as
// different positions.
bool stand_at_one_place(const Split& split) {
  const double rounding = kPositionRounding * length_of(mean_position(split));
  return position_spread(cameras_of(split)) <= std::clamp(rounding, kLeastRounding, kMostRounding);
}

// Returns the rounded mean of the camera positions if they are far from the origin, otherwise zero. The mean
// is rounded to whole units. If a unit is so large compared with the extent that coordinates relative to the
// rounded mean could still be far from the origin, the mean is rounded to multiples of the largest power of
// ten that is at most the extent. This is not done for cameras at one place (`one_place`), whose extent is 0
// or a rounding error.
std::array<double, 3> choose_offset(const Split& split, bool one_place) {
  std::array<double, 3> mean = mean_position(split);
  const double extent = split.views.size() < 2 ? 0 : scene_extent(split.views);
  if (split.views.size() < 2 || !(length_of(mean) > kFarFromOrigin * extent)) return {};
  // The mean is rounded to multiples of 1 / steps. `steps` is a whole number, so that the rounded mean has
  // few decimal places.
  double steps = 1;
  if (!one_place && std::sqrt(3) / 2 > kFarFromOrigin * extent)
    steps = std::pow(10, std::ceil(-std::log10(extent)));
  for (double& m : mean) m = std::round(m * steps) / steps + 0.0;  // turns -0 into 0
  return mean;
}

// Moves the origin of all splits to the position that the cameras of `reference`, a split of `data`, have in
// common, and makes their positions exactly equal, so that at_one_place() returns true.
void unite_positions(Dataset& data, Split& reference) {
  const std::array<double, 3> mean = mean_position(reference);
  std::array<double, 3> to = data.offset;
  if (length_of(mean) > kLeastRounding)
    for (std::size_t k = 0; k < 3; ++k) to[k] += mean[k];
  for (Split& split : data.splits) rebase(split.views, data.offset, to);
  for (View& view : reference.views) view.camera.translation = {};
  data.offset = to;
}

// Returns the depth bounds, or none if some of them are not usable. Then the positions of the cameras
// determine the initial positions of the splats, as for data without depth bounds.
std::vector<std::array<double, 2>> usable_bounds(std::vector<std::array<double, 2>> bounds,
                                                 LoadReport& report) {
  const auto bad = std::ranges::find_if_not(bounds, [](const std::array<double, 2>& b) {
    return b[0] > 0 && b[0] < b[1] && b[1] <= kMaxMagnitude;
  });
  if (bad == bounds.end()) return bounds;
  report.note_difference(
      fmt::format("the depth bounds of the data are not used, because {:.4g} and {:.4g} are not bounds (the "
                  "near bound must be positive and less than the far bound)",
                  (*bad)[0], (*bad)[1]));
  return {};
}

bool wanted(const DatasetOptions& options, const std::string& split) {
  return options.image_splits.empty() ||
         std::ranges::find(options.image_splits, split) != options.image_splits.end();
}

}  // namespace

const Split* Dataset::find(const std::string& split) const {
  const auto it = std::ranges::find(splits, split, &Split::name);
  return it == splits.end() ? nullptr : &*it;
}

// A camera maps the position p, which is relative to `from`, to R p + t. The same position relative to `to`
// is p - (to - from). So R (to - from) must be added to the translation t.
void rebase(std::vector<View>& views, const std::array<double, 3>& from, const std::array<double, 3>& to) {
  for (View& view : views)
    for (std::size_t r = 0; r < 3; ++r)
      for (std::size_t k = 0; k < 3; ++k)
        view.camera.translation[r] += view.camera.rotation[3 * r + k] * (to[k] - from[k]);
}

void note_not_finite(const WorldPoints& points, LoadReport& report) {
  if (points.not_finite > 0)
    report.note_difference(
        fmt::format("{} points are not used, because a coordinate is not finite", points.not_finite));
}

void take_points(const fs::path& file, LoadedScene& scene) {
  WorldPoints points = read_world_points(file);
  const std::string name = file.filename().string();
  if (is_random_filling(points)) {
    scene.report.note_difference(
        fmt::format("{}: not used, because its {} points are uniformly random, like those that 3DGS code "
                    "writes for data without points",
                    name, points.positions.size()));
    return;
  }
  note_not_finite(points, scene.report);
  if (!points.unused.empty()) scene.report.note_difference(fmt::format("{}: {}", name, points.unused));
  scene.points = std::move(points);
}

void note_shared_images(const std::vector<Split>& splits, LoadReport& report) {
  const auto train = std::ranges::find(splits, "train", &Split::name);
  if (train == splits.end()) return;
  std::unordered_set<std::string> of_train;
  for (const View& view : train->views) of_train.insert(view.file.string());
  for (const Split& split : splits) {
    if (split.name == "train") continue;
    std::set<fs::path> shared;
    for (const View& view : split.views)
      if (!view.file.empty() && of_train.contains(view.file.string())) shared.insert(view.file);
    if (!shared.empty())
      report.note_difference(fmt::format(
          "{} images of the split {} are also training images (such as {}): metrics of these images do not "
          "measure the quality of new views",
          shared.size(), split.name, shared.begin()->filename().string()));
  }
}

bool has_image_extension(const fs::path& path) {
  static const std::set<std::string> kKnown{".png", ".jpg", ".jpeg", ".jpe",  ".jfif",
                                            ".exr", ".tif", ".tiff", ".webp", ".bmp"};
  return kKnown.contains(small_extension(path));
}

std::vector<fs::path> pictures_in(const fs::path& folder) {
  std::vector<fs::path> pictures;
  if (!is_folder(folder)) return pictures;
  // Hidden files are skipped: macOS writes files whose names start with "._", and they contain no image.
  for (const fs::path& file : folder_entries(folder))
    if (!file.filename().string().starts_with('.') && has_image_extension(file) && is_regular(file))
      pictures.push_back(file);
  return pictures;
}

namespace {

// OtherPictures describes a kind of files that contain images, but that ubs does not read as images.
struct OtherPictures {
  const char* what;  // name of the kind in messages
  std::initializer_list<std::string_view> extensions;
  // Command that converts the files to images in the same folder. {0} is the name of a file, and {1} is a
  // list of patterns, such as *.heic, which match all files.
  const char* command;
};

const OtherPictures kVideo{
    "video", {".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v"}, "ffmpeg -i {0} -vf fps=2 %04d.png"};
const OtherPictures kHeic{"HEIC photograph",
                          {".heic", ".heif", ".hif"},
                          R"(for f in {1}; do heif-convert "$f" "${{f%.*}}.jpg"; done)"};
const OtherPictures kRaw{"RAW photograph",
                         {".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw"},
                         R"(for f in {1}; do darktable-cli "$f" "${{f%.*}}.jpg"; done)"};

const OtherPictures* other_pictures(const fs::path& file) {
  if (file.filename().string().starts_with('.') || !is_regular(file)) return nullptr;
  for (const OtherPictures* kind : {&kVideo, &kHeic, &kRaw})
    if (std::ranges::find(kind->extensions, small_extension(file)) != kind->extensions.end()) return kind;
  return nullptr;
}

std::string conversion_of(const OtherPictures& kind, const std::vector<fs::path>& files) {
  const fs::path& file = files.front();
  const fs::path folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
  std::set<std::string> patterns;
  for (const fs::path& each : files) patterns.insert("*" + each.extension().string());
  return fmt::format("cd {}; {}", shell_word(folder.string()),
                     fmt::format(fmt::runtime(kind.command), shell_word(file.filename().string()),
                                 fmt::join(patterns, " ")));
}

}  // namespace

std::string how_to_make_images(const fs::path& path) {
  if (!is_folder(path)) {
    const OtherPictures* kind = other_pictures(path);
    if (kind == &kVideo)
      return fmt::format(
          "this is a video: extract its frames ('mkdir photos; ffmpeg -i {} -vf fps=2 photos/%04d.png'), "
          "then find their cameras with 'ubs cameras photos'",
          shell_word(path.string()));
    return kind ? fmt::format(
                      "this is one {}, which ubs does not read: convert all photographs in its folder "
                      "('{}'), then pass the "
                      "folder to 'ubs cameras'",
                      kind->what, conversion_of(*kind, {path}))
                : std::string();
  }
  for (const fs::path& folder : {path, path / "images"}) {
    if (!is_folder(folder)) continue;
    std::map<const OtherPictures*, std::vector<fs::path>> found;
    for (const fs::path& file : folder_entries(folder))
      if (const OtherPictures* kind = other_pictures(file)) found[kind].push_back(file);
    for (const auto& [kind, files] : found)
      return fmt::format("{} {}{}, which ubs does not read as images: convert them ('{}')", files.size(),
                         kind->what, files.size() == 1 ? "" : "s", conversion_of(*kind, files));
  }
  return {};
}

void refuse_unused(const DatasetOptions& options, std::string_view layout, std::string_view used) {
  const DatasetOptions usual;
  for (const auto& [option, given] :
       {std::pair{"--images", options.read.images != usual.read.images},
        std::pair{"--colmap-model", options.read.colmap_model != usual.read.colmap_model},
        // The values 0 and kTestEvery are accepted for every layout. 0 means that no training views are held
        // out as test views, which is always the case for data that state their test views. Earlier versions
        // of ubs recorded kTestEvery in every run, whatever the layout of its data was.
        std::pair{"--test-every", options.read.test_every != usual.read.test_every &&
                                      options.read.test_every != 0 && options.read.test_every != kTestEvery},
        std::pair{"--frames", options.read.frames != usual.read.frames}})
    if (given && used.find(option) == std::string_view::npos)
      fail(ErrorKind::usage, "the layout {} does not use {}: remove it", layout, option);
}

namespace {

// Layout describes a layout of data folders. A new layout needs a loader, a row in the table kLayouts, and a
// section in docs/data.md.
struct Layout : LayoutText {
  // Returns the files in `path` by which this layout is recognised (for COLMAP, the folder of the model), or
  // nothing if `path` does not have this layout.
  std::vector<std::string> (*camera_files)(const fs::path& path);
  LoadedScene (*load)(const fs::path& path, const DatasetOptions& options);
  // Options that the loader uses. open_undecoded() refuses the other options that refuse_unused() checks,
  // unless refuses_itself is true.
  std::string_view used;
  // True if the loader calls refuse_unused() itself, and for packed files: the settings of a run are also
  // used with a packed copy of its data. For these files, open_data.cpp refuses options that the user set.
  bool refuses_itself = false;

  std::string description() const {
    return title.empty() ? std::string(files) : fmt::format("{} ({})", files, title);
  }
};

std::vector<std::string> named_if(bool found, const fs::path& name) {
  return found ? std::vector{name.string()} : std::vector<std::string>{};
}

// The layouts, in the order in which they are tried.
constexpr Layout kLayouts[] = {
    {{"packed", "", "a file of ubs pack"},
     [](const fs::path& path) { return named_if(is_packed(path), path); },
     load_packed,
     "",
     true},
    {{"blender", "Blender, D-NeRF", "transforms_train.json, transforms_val.json or transforms_test.json"},
     [](const fs::path& path) {
       std::vector<std::string> names;
       for (const char* split : kSplits)
         if (has_blender_split(path, split)) names.push_back(fmt::format("transforms_{}.json", split));
       return names;
     },
     load_blender,
     "--images"},
    {{"nerfstudio", "nerfstudio, NeRFCapture", "transforms.json"},
     [](const fs::path& path) {
       if (is_regular(path))
         return named_if(small_extension(path) == ".json" && opensfm_files(path).empty(), path);
       return named_if(path_exists(path / "transforms.json"), "transforms.json");
     },
     load_nerfstudio,
     "--images --test-every"},
    {{"colmap", "COLMAP", "sparse/0/cameras.bin or cameras.txt"},
     [](const fs::path& path) {
       const fs::path model = find_colmap_model(path);
       return named_if(!model.empty(), model);
     },
     load_colmap,
     "--images --colmap-model --test-every"},
    {{"llff", "LLFF, N3V", "poses_bounds.npy"},
     [](const fs::path& path) {
       return named_if(path_exists(path / "poses_bounds.npy"), "poses_bounds.npy");
     },
     load_llff,
     "",
     true},
    {{"metashape", "Metashape", "*.xml with <document> and <chunk>"},
     metashape_files,
     load_metashape,
     "--images --test-every"},
    {{"realitycapture", "RealityCapture, RealityScan",
      "*.csv with the columns name, heading, f, ...; or *.xmp with xcr:Rotation for the images"},
     realitycapture_files,
     load_realitycapture,
     "--images --test-every"},
    {{"opensfm", "OpenSfM, ODM", "reconstruction.json or opensfm/reconstruction.json"},
     opensfm_files,
     load_opensfm,
     "--images --test-every"},
    {{"bundler", "Bundler", "bundle.out with list.txt"},
     bundler_files,
     load_bundler,
     "--images --test-every"},
    {{"polycam", "Polycam", "keyframes/corrected_cameras/*.json or keyframes/cameras/*.json"},
     polycam_files,
     load_polycam,
     "--images --test-every"},
    {{"record3d", "Record3D", "metadata or metadata.json with poses and K"},
     record3d_files,
     load_record3d,
     "--images --test-every"},
};

const Layout& layout_named(std::string_view name) {
  for (const Layout& layout : kLayouts)
    if (layout.name == name) return layout;
  std::vector<std::string_view> known{"auto"};
  for (const Layout& layout : kLayouts) known.push_back(layout.name);
  fail(ErrorKind::usage, "unknown layout '{}': choose one of {}", name, fmt::join(known, ", "));
}

// Returns whether the file is JSON and its top level has a non-empty array `frames` of objects.
bool has_frames(const fs::path& file) {
  const std::string text = read_text_file(file);
  if (text.find("\"frames\"") == std::string::npos) return false;
  try {
    const Json json = parse_json(text, file.string());
    return json.is_object() && json.contains("frames") && json["frames"].is_array() &&
           !json["frames"].empty() && json["frames"][0].is_object();
  } catch (const std::exception&) {  // the file is damaged, so it is not suggested
    return false;
  }
}

// If the folder contains JSON files with frames, such as transforms_colmap.json, throws an error whose
// message lists them.
void name_transforms_files(const fs::path& folder) {
  std::vector<std::string> names;
  for (const fs::path& file : folder_entries(folder))
    if (small_extension(file) == ".json" && is_regular(file) && has_frames(file))
      names.push_back(file.filename().string());
  if (names.empty()) return;
  fail(ErrorKind::data, "{}: no transforms.json, but {} {} frames with cameras: give the file itself: {}",
       folder.string(), fmt::join(names, ", "), names.size() == 1 ? "has" : "have",
       shell_word((folder / names.front()).string()));
}

// Returns the layout of a folder, or null. A folder that cannot be read has no layout.
const Layout* layout_of(const fs::path& folder) {
  try {
    for (const Layout& layout : kLayouts)
      if (!layout.camera_files(folder).empty()) return &layout;
  } catch (const std::exception&) {
  }
  return nullptr;
}

// Lists the subfolders of a folder, and their subfolders, except hidden ones. One more level is listed below
// folders that COLMAP creates.
void list_subfolders(const fs::path& folder, int levels, std::vector<fs::path>& list) {
  if (levels == 0) return;
  for (const fs::path& entry : folder_entries(folder)) {
    const std::string name = entry.filename().string();
    if (name.starts_with('.') || has_image_extension(entry) || !is_folder(entry)) continue;
    list.push_back(entry);
    try {
      list_subfolders(entry, name == "sparse" || name == "colmap" ? levels : levels - 1, list);
    } catch (const std::exception&) {  // a folder that cannot be read contains no data
    }
  }
}

// If one of the paths contains cameras of another program, throws an error whose message names the program.
void name_other_program(const std::vector<fs::path>& paths, OtherProgram::Content content) {
  for (const fs::path& path : paths)
    if (const std::string what = describe_other_program(path, content); !what.empty())
      fail(ErrorKind::data, "{}: {}", path.string(), what);
}

// If a subfolder or the parent folder contains cameras, throws an error whose message says what to pass
// instead of `folder`. If the folder itself contains cameras of another program, the message names the
// program. `below` contains `folder` and its subfolders.
void name_folders_nearby(const fs::path& folder, const std::vector<fs::path>& below) {
  std::vector<fs::path> models, packed;
  std::vector<std::string> data;
  for (const fs::path& sub : below) {
    for (const char* name : {"cameras.bin.gz", "cameras.txt.gz"})
      if (path_exists(sub / name)) packed.push_back(sub / name);
    const Layout* layout = layout_of(sub);
    if (!layout) continue;
    if (layout->load == load_colmap && !is_folder(sub / "images") && pictures_in(sub).empty())
      models.push_back(sub);
    else
      data.push_back(fmt::format("{} ({})", shell_word(sub.string()), layout->name));
  }
  if (!data.empty())
    fail(ErrorKind::data, "{}: not a data set, but {}: pass {}", folder.string(),
         data.size() == 1 ? "one of its subfolders is" : "some of its subfolders are",
         data.size() > 3   ? fmt::format("one of {}, ... ({} folders)",
                                         fmt::join(data.begin(), data.begin() + 3, ", "), data.size())
         : data.size() > 1 ? fmt::format("one of {}", fmt::join(data, ", "))
                           : data.front());
  name_other_program({folder}, OtherProgram::Content::cameras);
  fs::path above = (folder / "..").lexically_normal();
  if (above.filename().empty()) above = above.parent_path();  // removes the slash at the end
  if (const Layout* layout = layout_of(above))
    fail(ErrorKind::data, "{}: not a data set: pass the folder above it, {} ({})", folder.string(),
         shell_word(above.string()), layout->name);
  if (!models.empty()) {
    const fs::path& sub = models.front();
    const fs::path images = *std::ranges::max_element(
        below, {}, [](const fs::path& candidate) { return pictures_in(candidate).size(); });
    fail(
        ErrorKind::data,
        "{}: not a data set, but there is a COLMAP model in {}: move its files to {}, or pass {} --images {}",
        folder.string(), find_colmap_model(sub).string(), (folder / "sparse/0").string(),
        shell_word(sub.string()), shell_word(images.lexically_relative(sub).string()));
  }
  if (!packed.empty())
    fail(ErrorKind::data, "{}: {} is packed: unpack the files first: gunzip {}/*.gz", folder.string(),
         packed.front().string(), shell_word(packed.front().parent_path().string()));
}

// Adds a note for each layout other than `used` whose files the folder also contains.
void note_other_layouts(const fs::path& path, const Layout& used, LoadReport& report) {
  for (const Layout& layout : kLayouts)
    if (&layout != &used && !layout.camera_files(path).empty())
      report.note(fmt::format("the folder also has {}: not used (to use it instead: --layout {})",
                              layout.description(), layout.name));
}

// Adds notes about pinhole cameras whose intrinsics are unusual, so that they may be wrong. Views that show a
// part of a wide image are not tested, because they are cropped.
void note_unusual_lenses(const std::vector<Split>& splits, LoadReport& report) {
  constexpr double kWidest = 170, kDegree = 3.14159265358979 / 180;
  struct Found {
    std::size_t count = 0;
    const View* first = nullptr;
    void add(const View& view) { first = count++ == 0 ? &view : first; }
  } outside, wide;
  // The angle of an image whose principal point is its centre, because the principal point may be wrong too.
  const auto widest = [&](const Camera& c) {
    return 2 / kDegree * std::atan(std::max(c.width / c.fx, c.height / c.fy) / 2);
  };
  for (const Split& split : splits)
    for (const View& view : split.views) {
      const Camera& c = view.camera;
      if (!view.part_of.empty()) continue;
      if (!(c.cx >= 0 && c.cx <= c.width && c.cy >= 0 && c.cy <= c.height)) outside.add(view);
      if (widest(c) > kWidest) wide.add(view);
    }
  if (const View* v = outside.first)
    report.note(
        fmt::format("the principal point of {} views is outside of the image (such as {}: {:.6g}, "
                    "{:.6g} in an image of {}x{} pixels)",
                    outside.count, v->name, v->camera.cx, v->camera.cy, v->camera.width, v->camera.height));
  if (const View* v = wide.first)
    report.note(
        fmt::format("the angle of view of {} pinhole views is larger than {:g} degrees (such as {}: {:.1f} "
                    "degrees): is the focal length in pixels? Values relative to the image size must be "
                    "multiplied by its width and height",
                    wide.count, kWidest, v->name, widest(v->camera)));
}

}  // namespace

std::vector<LayoutText> layout_texts() {
  std::vector<LayoutText> texts;
  for (const Layout& layout : kLayouts) texts.push_back(layout);
  return texts;
}

std::string layout_titles() {
  std::vector<std::string_view> titles;
  for (const Layout& layout : kLayouts)
    if (!layout.title.empty()) titles.push_back(layout.title);
  return fmt::format("{}", fmt::join(titles, ", "));
}

std::string detect_layout(const fs::path& path) {
  if (!is_folder(path) && !is_regular(path)) fail(ErrorKind::data, "{}: no such data folder", path.string());
  // The layout nerfstudio accepts all JSON files.
  if (!is_folder(path) && small_extension(path) == ".json")
    for (const auto content : {OtherProgram::Content::cameras, OtherProgram::Content::splats})
      name_other_program({path}, content);
  for (const Layout& layout : kLayouts)
    if (!layout.camera_files(path).empty()) return std::string(layout.name);
  if (!is_folder(path)) {
    const std::string what = describe_file(path);
    fail(ErrorKind::data, "{}: not a data set{}", path.string(),
         what.empty() ? ": pass a data folder, a transforms file (.json) or a packed data set (.ubsd)"
                      : ", but " + what);
  }
  // A run that was killed has no model.ply.
  if (path_exists(path / "config.yaml") && (path_exists(path / "model.ply") || path_exists(path / "log.csv")))
    fail(ErrorKind::data,
         "{}: this is the output folder of a training run, not a data set: pass the folder of its data",
         path.string());
  name_transforms_files(path);
  std::vector<fs::path> below{path};
  list_subfolders(path, 2, below);
  name_other_program({path}, OtherProgram::Content::moments);
  name_folders_nearby(path, below);
  name_other_program(below, OtherProgram::Content::cameras);
  if (const std::string what = describe_splat_folder(path); !what.empty())
    fail(ErrorKind::data, "{}: not a data set, but {}", path.string(), what);
  for (const fs::path& folder : {path, path / "images"})
    if (const std::size_t count = pictures_in(folder).size(); count > 1)
      fail(ErrorKind::data, "{}: {} images but no cameras: find the cameras with COLMAP: ubs cameras {}",
           path.string(), count, shell_word(path.string()));
  if (const std::string hint = how_to_make_images(path); !hint.empty())
    fail(ErrorKind::data, "{}: {}, then find their cameras with 'ubs cameras {}'", path.string(), hint,
         shell_word(path.string()));
  std::vector<std::string> known;
  for (const Layout& layout : kLayouts) known.push_back(layout.description());
  fail(ErrorKind::data, "{}: not a data set: the folder has none of: {}", path.string(),
       fmt::join(known, "; "));
}

std::string camera_files_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const Layout& layout : kLayouts)
    for (std::string& name : layout.camera_files(folder)) names.push_back(std::move(name));
  return fmt::format("{}", fmt::join(names, ", "));
}

Dataset open_undecoded(const fs::path& path, const DatasetOptions& options) {
  const Layout& layout =
      layout_named(options.read.layout == "auto" ? detect_layout(path) : options.read.layout);
  if (layout.name != "packed" && is_packed(path))
    fail(ErrorKind::usage, "{}: this is a packed data set, so the layout cannot be {}: remove --layout",
         path.string(), layout.name);
  if (!layout.refuses_itself) refuse_unused(options, layout.name, layout.used);
  LoadedScene scene = layout.load(path, options);

  Dataset data;
  data.splits = std::move(scene.splits);
  for (Split& split : data.splits) {
    split.name = safe_file_name(split.name);
    make_view_names_unique(split.views);
    if (options.read.principal_point == PrincipalPoint::centre)
      for (View& view : split.views)
        view.camera.cx = view.camera.width / 2.0, view.camera.cy = view.camera.height / 2.0;
  }
  data.depth_bounds = usable_bounds(std::move(scene.depth_bounds), scene.report);
  data.report = std::move(scene.report);
  note_unusual_lenses(data.splits, data.report);
  if (options.read.test_every == 0 &&
      std::ranges::find(data.splits, "test", &Split::name) != data.splits.end())
    data.report.note("--test-every 0 has no effect, because the data determine the test views");
  if (options.read.layout == "auto") note_other_layouts(path, layout, data.report);
  const auto& results = data.report.undistorted;
  for (const auto& [pixels, text] : results)
    data.report.note_difference(results.size() == 1                ? text
                                : pixels == results.begin()->first ? text + ", the smallest"
                                                                   : text + ", the largest");
  if (data.report.wide_images > 0)
    data.report.note_difference(
        fmt::format("{} wide images were split into {} pinhole views of at most 90 degrees",
                    data.report.wide_images, data.report.wide_views));
  data.report.layout = layout.name;
  data.report.folder = path.string();
  const auto train = std::ranges::find(data.splits, "train", &Split::name);
  Split& reference = train == data.splits.end() ? data.splits.front() : *train;
  const bool one_place = stand_at_one_place(reference);
  data.offset = scene.offset == std::array<double, 3>{} ? choose_offset(reference, one_place) : scene.offset;
  if (data.offset != std::array<double, 3>{})
    for (Split& split : data.splits) rebase(split.views, scene.offset, data.offset);
  if (one_place && !at_one_place(cameras_of(reference))) unite_positions(data, reference);
  if (data.offset != std::array<double, 3>{})
    data.report.note(
        fmt::format("{}: coordinates are relative to ({}, {}, {})",
                    one_place ? "all cameras have the same position" : "data far from the origin",
                    data.offset[0], data.offset[1], data.offset[2]));
  std::array<double, 3> moved = data.offset;
  for (std::size_t k = 0; k < 3; ++k) moved[k] -= scene.offset[k];
  if (scene.points && !scene.points->positions.empty()) data.points = subtract_offset(*scene.points, moved);
  return data;
}

void decode_images(Dataset& data, const DatasetOptions& options) {
  std::vector<View*> pending;
  std::size_t bytes = 0;
  for (Split& split : data.splits)
    for (View& view : split.views) {
      if (!wanted(options, split.name)) view.source.reset();
      if (!view.source) continue;
      pending.push_back(&view);
      bytes += view.image_bytes();
    }
  const std::size_t cache = static_cast<std::size_t>(options.read.image_cache_mb) << 20;
  if (bytes > cache) {
    data.report.note(fmt::format("{} images need {} MB, but the cache has {} MB: they are decoded on demand",
                                 pending.size(), bytes >> 20, options.read.image_cache_mb));
    return;
  }
  // Only one frame of a video can be decoded at a time. Sorting by time makes neighbours in the list come
  // from different videos, so that threads do not wait for each other.
  std::ranges::stable_sort(pending, {}, [](const View* view) { return view->camera.time; });
  parallel_for(pending.size(), [&](std::size_t i) {
    pending[i]->image = pending[i]->source->load();
    pending[i]->source.reset();
  });
}

Dataset load_dataset(const fs::path& path, const DatasetOptions& options) {
  Dataset data = open_undecoded(path, options);
  decode_images(data, options);
  return data;
}

}  // namespace ubs
