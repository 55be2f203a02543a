// SPDX-License-Identifier: Apache-2.0
// See colmap.hpp. This file chooses the model of a folder, creates the lenses and reads the binary files.
#include "host/dataset/colmap.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/byte_reader.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/scene/camera.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

const LensModel& colmap_model_of_name(const std::string& name, const std::string& where) {
  const auto row = std::ranges::find(lens_models(), std::string_view(name), &LensModel::name);
  if (row == lens_models().end() || row->number < 0)
    fail(ErrorKind::data,
         "{}: camera model '{}' is not known: undistort with 'colmap image_undistorter', or use one of {}",
         where, name.substr(0, 40), known_lens_models());
  return *row;
}

void check_end(const ByteReader& in) {
  if (in.remaining() > 0)
    fail(ErrorKind::data, "{}: {} bytes follow the last record", in.name(), in.remaining());
}

void read_binary_cameras(const fs::path& path, ColmapModel& model) {
  const std::vector<std::byte> bytes = read_file(path);
  ByteReader in(bytes, path.string());
  const std::size_t count = in.read_count<std::uint64_t>(24, "cameras");
  for (std::size_t i = 0; i < count; ++i) {
    const std::string where = fmt::format("{}: camera {}", path.string(), i);
    const auto id = in.read<std::uint32_t>();
    const LensModel& lens = colmap_model(in.read<std::int32_t>(), where);
    const auto width = in.read<std::uint64_t>(), height = in.read<std::uint64_t>();
    std::vector<double> parameters(words_of(lens.parameters).size());
    for (double& p : parameters) p = in.read<double>();
    add_colmap_camera(model, id, std::string(lens.name), width, height, parameters, where);
  }
  check_end(in);
}

void read_binary_images(const fs::path& path, ColmapModel& model) {
  const std::vector<std::byte> bytes = read_file(path);
  ByteReader in(bytes, path.string());
  const std::size_t count = in.read_count<std::uint64_t>(73, "images");
  for (std::size_t i = 0; i < count; ++i) {
    ColmapImage image;
    in.skip(sizeof(std::uint32_t));  // number of the image
    for (double& q : image.rotation) q = in.read<double>();
    for (double& t : image.translation) t = in.read<double>();
    image.camera = in.read<std::uint32_t>();
    image.name = in.read_string();
    in.skip(24 * in.read_count<std::uint64_t>(24, "observations"));
    add_colmap_image(model, std::move(image), fmt::format("{}: image {}", path.string(), i));
  }
  check_end(in);
}

void read_binary_points(const fs::path& path, ColmapModel& model) {
  const std::vector<std::byte> bytes = read_file(path);
  ByteReader in(bytes, path.string());
  const std::size_t count = in.read_count<std::uint64_t>(51, "points");
  model.points.positions.reserve(count);
  model.points.colours.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    std::array<double, 3> position{};
    std::array<std::uint8_t, 3> colour{};
    in.skip(sizeof(std::uint64_t));  // number of the point
    for (double& c : position) c = in.read<double>();
    for (std::uint8_t& c : colour) c = in.read<std::uint8_t>();
    in.skip(sizeof(double));  // reprojection error
    in.skip(8 * in.read_count<std::uint64_t>(8, "track elements"));
    add_point(model.points, position, colour, i, path.string());
  }
  check_end(in);
}

bool is_model(const fs::path& folder) {
  return path_exists(folder / "cameras.bin") || path_exists(folder / "cameras.txt");
}

}  // namespace

const LensModel& colmap_model(int number, const std::string& where) {
  const auto row = std::ranges::find(lens_models(), number, &LensModel::number);
  if (number < 0 || row == lens_models().end())
    fail(ErrorKind::data,
         "{}: camera model number {} is not known: undistort with 'colmap image_undistorter', or use one of "
         "{}",
         where, number, known_lens_models());
  return *row;
}

ColmapCamera make_colmap_camera(const std::string& model, std::uint64_t width, std::uint64_t height,
                                const std::vector<double>& parameters, const std::string& where) {
  const LensModel& row = colmap_model_of_name(model, where);
  const std::vector<std::string_view> names = words_of(row.parameters);
  if (parameters.size() != names.size())
    fail(ErrorKind::data, "{}: model {} has {} parameters ({}), found {}", where, model, names.size(),
         row.parameters, parameters.size());
  if (width < 1 || height < 1 || width > kMaxPixelsAcross || height > kMaxPixelsAcross)
    fail(ErrorKind::data, "{}: the image size {}x{} is not possible: width and height must be 1 to {}", where,
         width, height, kMaxPixelsAcross);
  ColmapCamera camera{model, {}};
  camera.lens.formula = row.formula;
  camera.lens.width = static_cast<int>(width);
  camera.lens.height = static_cast<int>(height);
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!std::isfinite(parameters[i]))
      fail(ErrorKind::data, "{}: parameter '{}' is not finite", where, names[i]);
    camera.lens.set(names[i], parameters[i]);
  }
  check_lens(camera.lens, where);
  return camera;
}

void add_colmap_camera(ColmapModel& model, std::uint32_t id, const std::string& name, std::uint64_t width,
                       std::uint64_t height, const std::vector<double>& parameters,
                       const std::string& where) {
  if (!std::ranges::all_of(parameters, [](double p) { return std::isfinite(p); })) {
    model.unusable.insert(id);
    return;
  }
  try {
    model.cameras[id] = make_colmap_camera(name, width, height, parameters, where);
  } catch (const Error& error) {  // add_colmap_image() throws it if an image has this camera
    model.refused[id] = error.what();
  }
}

void add_colmap_image(ColmapModel& model, ColmapImage image, const std::string& where) {
  double norm = 0;
  bool finite = true;
  for (const double q : image.rotation) norm += q * q, finite = finite && std::isfinite(q);
  for (const double t : image.translation) finite = finite && std::isfinite(t);
  // COLMAP's mapper writes values that are not finite for an image that it could not register, or for a
  // camera that it could not calibrate.
  if (!finite || model.unusable.contains(image.camera)) {
    model.unplaced.push_back(image.name);
    return;
  }
  if (!(norm > 1e-12) || !std::isfinite(norm))
    fail(ErrorKind::data, "{}: the rotation is not a valid quaternion", where);
  for (double& q : image.rotation) q /= std::sqrt(norm);
  if (image.name.empty()) fail(ErrorKind::data, "{}: the image has no name", where);
  if (const auto refused = model.refused.find(image.camera); refused != model.refused.end())
    fail(ErrorKind::data, "{}", refused->second);
  if (!model.cameras.contains(image.camera))
    fail(ErrorKind::data, "{}: camera {} of image '{}' does not exist", where, image.camera, image.name);
  model.images.push_back(std::move(image));
}

fs::path find_colmap_model(const fs::path& data, const std::string& name, LoadReport* report) {
  std::vector<fs::path> models;
  const auto add = [&](const fs::path& folder) {
    if (is_model(folder)) models.push_back(folder);
  };
  for (const fs::path& above : {data / "sparse", data / "colmap" / "sparse"}) {
    if (!models.empty() || !is_folder(above)) continue;
    add(above / "0");
    add(above);
    for (const fs::path& folder : folder_entries(above))
      if (folder.filename() != "0" && !folder.filename().string().starts_with('.')) add(folder);
  }
  if (models.empty()) add(data);
  if (models.empty() || (models.size() == 1 && name == "auto"))
    return models.empty() ? fs::path() : models[0];
  std::vector<std::string> words;
  std::vector<std::size_t> counts;
  for (const fs::path& model : models) {
    counts.push_back(count_colmap_images(model));
    words.push_back(fmt::format("{} ({} images)", model.lexically_relative(data).string(), counts.back()));
  }
  std::size_t chosen = static_cast<std::size_t>(std::ranges::max_element(counts) - counts.begin());
  if (name != "auto") {
    const auto named = std::ranges::find_if(models, [&](const fs::path& m) {
      return m.filename() == name || m.lexically_relative(data) == name;
    });
    if (named == models.end())
      fail(ErrorKind::usage, "{}: there is no COLMAP model '{}': choose one of {} with --colmap-model",
           data.string(), name, fmt::join(words, ", "));
    chosen = static_cast<std::size_t>(named - models.begin());
  }
  if (report)
    report->note_difference(fmt::format(
        "found {} COLMAP models: {}; using {}, {}", models.size(), fmt::join(words, ", "),
        models[chosen].lexically_relative(data).string(),
        name == "auto" ? "the largest (choose another with --colmap-model NAME)" : "as requested"));
  return models[chosen];
}

std::size_t count_colmap_images(const fs::path& model) {
  if (!path_exists(model / "images.bin")) return count_colmap_text_images(model);
  std::size_t bytes = 0;
  std::ifstream stream = open_for_reading(model / "images.bin", bytes);
  std::uint64_t count = 0;
  stream.read(reinterpret_cast<char*>(&count), sizeof count);
  return stream ? static_cast<std::size_t>(count) : 0;
}

ColmapModel read_colmap_model(const fs::path& folder) {
  ColmapModel model;
  if (path_exists(folder / "cameras.bin"))
    read_binary_cameras(folder / "cameras.bin", model);
  else
    read_colmap_text_cameras(folder / "cameras.txt", model);
  if (path_exists(folder / "images.bin"))
    read_binary_images(folder / "images.bin", model);
  else if (path_exists(folder / "images.txt"))
    read_colmap_text_images(folder / "images.txt", model);
  else
    fail(ErrorKind::data, "{}: contains neither images.bin nor images.txt", folder.string());
  if (path_exists(folder / "points3D.bin"))
    read_binary_points(folder / "points3D.bin", model);
  else if (path_exists(folder / "points3D.txt"))
    read_colmap_text_points(folder / "points3D.txt", model);
  return model;
}

}  // namespace ubs
