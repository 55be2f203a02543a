// SPDX-License-Identifier: Apache-2.0
// load_llff() loads LLFF folders and N3V folders. An LLFF folder contains poses_bounds.npy with one row per
// image, and the images in the folder images/. An N3V folder contains poses_bounds.npy with one row per
// camera, and for each camera either a video or a folder of frames. The names of these videos and folders
// start with "cam". The views of the first camera of an N3V folder are the test views.
//
// A row consists of a 3x5 matrix, row-major, and the two depth bounds. The columns of the matrix are the
// directions down, right and back, the position in the world, and (height, width, focal length) of the
// full-size images.
#include <algorithm>
#include <map>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/base/vector3.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/image_source.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/named_files.hpp"
#include "host/dataset/npy.hpp"
#include "host/dataset/split_views.hpp"
#include "host/dataset/video.hpp"
#include "host/dataset/view_image.hpp"
#include "host/dataset/view_names.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

struct Row {
  Camera camera;  // only the pose is set
  Lens lens;
  std::array<double, 2> bounds{};
  std::string where;  // start of error messages about this row
};

Row parse_row(const double* row, const std::string& where) {
  // The depth bounds, which are the last two values, are checked later: unusable bounds are not used.
  for (int i = 0; i < 15; ++i) checked_input(row[i], fmt::format("{}: value {}", where, i));
  Row result;
  Camera& camera = result.camera;
  for (std::size_t k = 0; k < 3; ++k) {
    camera.rotation[k] = row[5 * k + 1];       // x: right
    camera.rotation[3 + k] = row[5 * k];       // y: down
    camera.rotation[6 + k] = -row[5 * k + 2];  // z: forward
  }
  camera.translation = -1.0 * rotated(camera.rotation, {row[3], row[8], row[13]});
  const double height = row[4], width = row[9], focal = row[14];
  if (!(height >= 1 && width >= 1 && height < 65536 && width < 65536 && focal > 0))
    fail(ErrorKind::data, "{}: image size {}x{} or focal length {} is not valid", where, width, height,
         focal);
  result.lens.fx = result.lens.fy = focal;
  result.lens.width = static_cast<int>(width);
  result.lens.height = static_cast<int>(height);
  result.lens.cx = width / 2;
  result.lens.cy = height / 2;
  result.bounds = {row[15], row[16]};
  result.where = where;
  check_rotation(camera.rotation, where + ": the pose");
  return result;
}

std::vector<Row> read_rows(const fs::path& path) {
  const NpyArray64 array = read_npy_double(path);
  if (array.shape.size() != 2 || array.shape[1] != 17 || array.shape[0] == 0)
    fail(ErrorKind::data, "{}: the shape is ({}), but must be (images, 17)", path.string(),
         fmt::join(array.shape, ", "));
  std::vector<Row> rows;
  for (std::size_t i = 0; i < array.shape[0]; ++i)
    rows.push_back(parse_row(&array.values[17 * i], fmt::format("{}: row {}", path.string(), i)));
  return rows;
}

bool is_video(const fs::path& path) {
  const std::string end = small_extension(path);
  return (end == ".mp4" || end == ".avi" || end == ".mkv" || end == ".mov") && is_regular(path);
}

// Returns whether the name `a` comes before `b` in natural order, in which runs of digits are compared as
// numbers: "9.png" comes before "10.png".
bool comes_before(std::string_view a, std::string_view b) {
  constexpr std::string_view kDigits = "0123456789";
  std::string_view x = a, y = b;
  while (!x.empty() && !y.empty()) {
    std::size_t m = std::min(x.find_first_not_of(kDigits), x.size());
    std::size_t n = std::min(y.find_first_not_of(kDigits), y.size());
    if (m > 0 && n > 0) {
      std::string_view p = x.substr(0, m), q = y.substr(0, n);
      p.remove_prefix(std::min(p.find_first_not_of('0'), m));
      q.remove_prefix(std::min(q.find_first_not_of('0'), n));
      if (p.size() != q.size()) return p.size() < q.size();
      if (p != q) return p < q;
    } else {
      m = n = 1;
      if (x[0] != y[0]) return x.substr(0, 1) < y.substr(0, 1);
    }
    x.remove_prefix(m), y.remove_prefix(n);
  }
  return x.empty() && y.empty() ? a < b : x.empty();
}

// Returns the images in a folder. The order of the images determines their cameras and times, so a missing
// image would shift all images after it. Therefore links to missing files are errors.
std::vector<fs::path> all_pictures_in(const fs::path& folder) {
  if (is_folder(folder))
    for (const fs::path& file : folder_entries(folder))
      if (has_image_extension(file) && is_dead_link(file))
        fail(ErrorKind::data, "{}: this is a symbolic link to a file that does not exist", file.string());
  return pictures_in(folder);
}

// Returns the frames of a camera in the order of time, which is the natural order of their names.
std::vector<fs::path> frames_in(const fs::path& folder) {
  std::vector<fs::path> files = all_pictures_in(folder);
  if (files.empty()) files = all_pictures_in(folder / "images");
  std::ranges::sort(files, [](const fs::path& a, const fs::path& b) {
    return comes_before(a.filename().native(), b.filename().native());
  });
  return files;
}

bool is_camera_folder(const fs::path& path) {
  return is_folder(path) && path.filename().string().starts_with("cam") && !frames_in(path).empty();
}

std::vector<fs::path> sorted_entries(const fs::path& folder, bool (*accept)(const fs::path&)) {
  std::vector<fs::path> found = folder_entries(folder);
  std::erase_if(found, [&](const fs::path& entry) { return !accept(entry); });
  return found;
}

// Sequence holds the images of one camera over time, which are frames of a video or separate files.
struct Sequence {
  fs::path path;
  std::shared_ptr<VideoFile> video;
  std::vector<fs::path> files;
  int frames() const { return video ? video_frames(*video) : static_cast<int>(files.size()); }
};

// Returns the frames to use from every camera. Frames that the shortest sequence does not have are skipped
// for all cameras, so that the cameras stay synchronous.
std::vector<int> chosen_frames(const std::vector<Sequence>& cameras, const DatasetOptions& options,
                               LoadReport& report) {
  const auto [least, most] = std::ranges::minmax_element(cameras, {}, &Sequence::frames);
  const int available = least->frames(), wanted = std::min(most->frames(), options.read.frames.end);
  std::vector<int> frames;
  for (int f = options.read.frames.first; f < std::min(available, wanted);
       f += std::max(1, options.read.frames.step))
    frames.push_back(f);
  if (frames.empty())
    fail(ErrorKind::data, "{}: there are only {} frames, but 'frames' starts at frame {}",
         least->path.string(), available, options.read.frames.first);
  if (available < wanted)
    report.note(fmt::format("{} has {} frames, but {} has {}: frames from {} on are not used",
                            least->path.filename().string(), available, most->path.filename().string(),
                            most->frames(), available));
  return frames;
}

double time_of(std::size_t i, std::size_t count) {
  return count > 1 ? static_cast<double>(i) / static_cast<double>(count - 1) : 0.0;
}

// Returns advice for users whose images are in another folder than expected: the option that names the folder
// with `count` images, or an empty string if there is no such folder.
std::string images_option(const fs::path& folder, std::size_t count) {
  for (const fs::path& entry : folder_entries(folder))
    if (const std::string name = entry.filename().string();
        name.starts_with("images") && pictures_in(entry).size() == count)
      return fmt::format(": choose the folder that has the images with --images {}", shell_word(name));
  if (pictures_in(folder).size() == count) return ": use the images in the data folder with --images .";
  return {};
}

LoadedScene load_static(const fs::path& folder, const fs::path& images, const std::vector<Row>& rows,
                        const DataRoot& root, NamedFiles& named, const DatasetOptions& options) {
  const std::vector<fs::path> files = all_pictures_in(images);
  if (!is_folder(images))
    fail(ErrorKind::data, "{}: this folder does not exist{}", images.string(),
         images_option(folder, rows.size()));
  if (files.size() != rows.size())
    fail(ErrorKind::data, "{}: {} images, but poses_bounds.npy has {} rows", images.string(), files.size(),
         rows.size());
  LoadedScene scene;
  std::vector<StatedName> names;
  for (std::size_t i = 0; i < rows.size(); ++i)
    names.push_back({files[i].filename().string(), rows[i].where});
  const std::vector<fs::path> masks = named.find_masks(names);
  std::vector<View> views;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    View view;
    view.name = files[i].stem().string();
    view.camera = rows[i].camera;
    attach_image(view, rows[i].lens, root.check(files[i], rows[i].where), masks[i], options, scene.report);
    check_camera(view.camera, rows[i].where);
    views.push_back(std::move(view));
  }
  make_view_names_unique(views);
  std::map<std::string, std::array<double, 2>> bounds;
  for (std::size_t i = 0; i < rows.size(); ++i) bounds[views[i].name] = rows[i].bounds;
  scene.splits = split_every(std::move(views), options.read.test_every);
  for (const View& view : scene.splits.front().views) scene.depth_bounds.push_back(bounds.at(view.name));
  return scene;
}

// Adds the views of one camera, one for each of the given frames of its video.
void add_video(std::vector<View>& views, const Sequence& sequence, const std::vector<int>& frames,
               const Row& row, const DatasetOptions& options, LoadReport& report) {
  const ImageSize size = video_size(*sequence.video);
  View prototype;
  // All frames of a video have the same size. attach_image cannot read this size from a file, so the lens is
  // scaled to it before the call.
  attach_image(prototype, row.lens.scaled_to(size.width, size.height), {}, {}, options, report);
  prototype.opaque = true;
  prototype.camera.rotation = row.camera.rotation, prototype.camera.translation = row.camera.translation;
  check_camera(prototype.camera, row.where);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    View view = prototype;
    view.camera.time = time_of(i, frames.size());
    view.name = fmt::format("{}_{:04d}", sequence.path.stem().string(), frames[i]);
    if (options.load_images) {
      const int width = view.camera.width, height = view.camera.height;
      view.source = video_frame_source(sequence.video, frames[i], width, height);
      if (!options.read.cache_folder.empty())
        view.source =
            cached_image_source(view.source,
                                fs::path(options.read.cache_folder) /
                                    cache_name(fmt::format("{}|frame {}|{}x{}", file_identity(sequence.path),
                                                           frames[i], width, height)),
                                width, height);
    }
    views.push_back(std::move(view));
  }
}

void add_frame_files(std::vector<View>& views, const Sequence& sequence, const std::vector<int>& frames,
                     const Row& row, const DataRoot& root, const DatasetOptions& options,
                     LoadReport& report) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    View view;
    view.camera = row.camera;
    view.camera.time = time_of(i, frames.size());
    view.name = fmt::format("{}_{:04d}", sequence.path.filename().string(), frames[i]);
    const fs::path& file = root.check(sequence.files[static_cast<std::size_t>(frames[i])], row.where);
    attach_image(view, row.lens, file, {}, options, report);
    check_camera(view.camera, row.where);
    views.push_back(std::move(view));
  }
}

LoadedScene load_dynamic(const fs::path& folder, const std::vector<fs::path>& cameras, bool videos,
                         const std::vector<Row>& rows, const DataRoot& root, const DatasetOptions& options) {
  refuse_unused(options, "N3V", "--frames");
  if (cameras.size() != rows.size())
    fail(ErrorKind::data, "{}: {} cameras, but poses_bounds.npy has {} rows", folder.string(), cameras.size(),
         rows.size());
  if (rows.size() < 2)
    fail(ErrorKind::data, "{}: with a single camera, no views remain for training", folder.string());
  std::vector<Sequence> sequences;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (videos)
      sequences.push_back({cameras[i], open_video(root.check(cameras[i], rows[i].where)), {}});
    else
      sequences.push_back({cameras[i], nullptr, frames_in(cameras[i])});
  LoadedScene scene;
  const std::vector<int> frames = chosen_frames(sequences, options, scene.report);
  scene.splits = {{"train", {}}, {"test", {}}};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::vector<View>& views = scene.splits[i == 0 ? 1 : 0].views;
    if (videos)
      add_video(views, sequences[i], frames, rows[i], options, scene.report);
    else
      add_frame_files(views, sequences[i], frames, rows[i], root, options, scene.report);
    if (i > 0) scene.depth_bounds.insert(scene.depth_bounds.end(), frames.size(), rows[i].bounds);
  }
  scene.report.note(fmt::format("the views of the first of {} cameras ({}) are the test split", rows.size(),
                                cameras[0].filename().string()));
  return scene;
}

}  // namespace

LoadedScene load_llff(const fs::path& folder, const DatasetOptions& options) {
  DataRoot root(folder, options.read.allow_outside);
  const std::vector<Row> rows = read_rows(root.check(folder / "poses_bounds.npy"));
  const fs::path images = folder / (options.read.images == "auto" ? "images" : options.read.images);
  std::vector<std::string> notes;
  // If the folder also has images, its videos or folders count as cameras only if there are as many as rows.
  // Otherwise they may be, for example, a recording of a walk through the scene.
  const auto cameras = [&](bool (*accept)(const fs::path&), const char* what) {
    std::vector<fs::path> found = sorted_entries(folder, accept);
    if (found.empty() || found.size() == rows.size() || !is_folder(images)) return found;
    notes.push_back(
        fmt::format("{} {} not used, because poses_bounds.npy has {} rows", found.size(), what, rows.size()));
    return std::vector<fs::path>{};
  };
  const auto videos = cameras(is_video, "videos are");
  const auto folders = videos.empty()
                           ? cameras(is_camera_folder, "folders of images whose names start with 'cam' are")
                           : std::vector<fs::path>{};
  LoadedScene scene;
  NamedFiles files(root, folder);  // finds the masks and reports files of the folder that are not used
  if (!videos.empty()) {
    scene = load_dynamic(folder, videos, true, rows, root, options);
  } else if (!folders.empty()) {
    scene = load_dynamic(folder, folders, false, rows, root, options);
  } else {
    refuse_unused(options, "LLFF", "--images --test-every");
    if (options.read.images != "auto" && options.images_from_user) root.add(images);
    scene = load_static(folder, images, rows, root, files, options);
  }
  for (const Split& split : scene.splits)
    for (const View& view : split.views)
      if (!view.file.empty()) files.use(view.file);
  files.report(scene.report);
  for (const std::string& note : notes) scene.report.note(note);
  for (const char* name : {"points3d.ply", "points3D.ply"})
    if (!scene.points && path_exists(folder / name)) take_points(root.check(folder / name), scene);
  return scene;
}

}  // namespace ubs
