// SPDX-License-Identifier: Apache-2.0
// load_metashape() loads the cameras that Metashape exports as XML ("Agisoft XML"). A camera has a pose in
// the coordinates of its chunk or component, whose transform leads to the world. The lens formulas and their
// conventions are those of the appendix "Camera models" of Metashape's manual.
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <optional>
#include <pugixml.hpp>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/stated_views.hpp"
#include "host/formats/other_programs.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

// Transform is the motion and scaling from a chunk or a component to the world: p = scale R x + t.
struct Transform {
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
  std::array<double, 3> translation{0, 0, 0};
  double scale = 1;
};

// Returns the child with this name, if it has text.
std::optional<std::string> text_of(const pugi::xml_node& node, const char* child) {
  const std::string text = node.child(child).text().get();
  return text.empty() ? std::nullopt : std::optional(text);
}

bool enabled(const pugi::xml_node& node) { return node.attribute("enabled").as_bool(true); }

std::optional<Transform> transform_of(const pugi::xml_node& node, const std::string& where) {
  const pugi::xml_node given = node.child("transform");
  if (!given) return std::nullopt;
  Transform result;
  if (const auto text = text_of(given, "rotation"))
    std::ranges::copy(numbers_in(*text, 9, where + ": rotation"), result.rotation.begin());
  if (const auto text = text_of(given, "translation"))
    std::ranges::copy(numbers_in(*text, 3, where + ": translation"), result.translation.begin());
  if (const auto text = text_of(given, "scale")) result.scale = number_in(*text, where + ": scale");
  if (!(result.scale > 0)) fail(ErrorKind::data, "{}: the scale must be positive", where);
  return result;
}

struct Sensor {
  ImageSize size;
  Lens lens;
  std::string unusable;  // the reason why its images cannot be used; empty if they can
};

Sensor read_sensor(const pugi::xml_node& node, const std::string& file) {
  const std::string where = fmt::format("{}: sensor {} ({})", file, node.attribute("id").as_string(),
                                        node.attribute("label").as_string());
  pugi::xml_node calibration = node.find_child_by_attribute("calibration", "class", "adjusted");
  if (!calibration) calibration = node.child("calibration");
  Sensor sensor;
  pugi::xml_node resolution = node.child("resolution");
  if (!resolution) resolution = calibration.child("resolution");
  sensor.size = {resolution.attribute("width").as_int(), resolution.attribute("height").as_int()};
  if (sensor.size.width < 1 || sensor.size.height < 1 ||
      std::max(sensor.size.width, sensor.size.height) > kMaxPixelsAcross)
    fail(ErrorKind::data, "{}: 'resolution' must have a width and a height from 1 to {}", where,
         kMaxPixelsAcross);
  std::string type = calibration.attribute("type").as_string();
  if (type.empty()) type = node.attribute("type").as_string("frame");
  const double width = sensor.size.width, height = sensor.size.height;
  if (type == "spherical") {
    sensor.lens = make_lens("EQUIRECTANGULAR", sensor.size, 1, 1, 0, 0);
    sensor.lens.set("w", width), sensor.lens.set("h", height);
    return sensor;
  }
  const bool fisheye = type == "fisheye" || type == "equidistant_fisheye";
  if (!fisheye && type != "frame") {
    sensor.unusable = fmt::format(
        "the lens type '{}' is not supported: undistort the images in Metashape (Export > Undistort Photos)",
        type);
    return sensor;
  }
  const auto value = [&](const char* name) {
    const auto text = text_of(calibration, name);
    return text ? number_in(*text, fmt::format("{}: {}", where, name)) : 0.0;
  };
  if (!text_of(calibration, "f")) {
    sensor.unusable = "its sensor has no calibration with a focal length 'f'";
    return sensor;
  }
  // u = w/2 + cx + x' f + x' b1 + y' b2 and v = h/2 + cy + y' f; the centre of the first pixel is (0.5, 0.5).
  const double f = value("f"), b2 = value("b2");
  sensor.lens = make_lens(fisheye ? "THIN_PRISM_FISHEYE" : "BROWN", sensor.size, f + value("b1"), f,
                          width / 2 + value("cx"), height / 2 + value("cy"));
  check_lens(sensor.lens, where);
  for (const char* name : {"k1", "k2", "k3", "k4"}) sensor.lens.set(name, value(name));
  // Metashape's p1 and p2 have exchanged places in the formula of OpenCV.
  sensor.lens.set("p1", value("p2")), sensor.lens.set("p2", value("p1"));
  if (!fisheye) sensor.lens.set("skew", b2 / sensor.lens.fx);
  for (const char* name : {"p3", "p4"})
    if (value(name) != 0)
      sensor.unusable = fmt::format("the lens coefficient {} is not supported: undistort the images", name);
  if (fisheye && b2 != 0)
    sensor.unusable = "the lens coefficient b2 of a fisheye is not supported: undistort the images";
  return sensor;
}

// Calls `visit` for each camera below the node. Cameras may be in groups.
void for_each_camera(const pugi::xml_node& node, const std::function<void(const pugi::xml_node&)>& visit) {
  for (const pugi::xml_node& child : node.children()) {
    const std::string_view name = child.name();
    if (name == "camera") visit(child);
    if (name == "group" || name == "camera")
      for (const pugi::xml_node& inner : child.children("camera")) visit(inner);
  }
}

std::size_t count_aligned(const pugi::xml_node& chunk) {
  std::size_t count = 0;
  for_each_camera(chunk.child("cameras"),
                  [&](const pugi::xml_node& camera) { count += text_of(camera, "transform").has_value(); });
  return count;
}

class ChunkReader {
 public:
  ChunkReader(const pugi::xml_node& chunk, std::string file, LoadReport& report)
      : file_(std::move(file)), report_(report) {
    for (const pugi::xml_node& sensor : chunk.child("sensors").children("sensor"))
      sensors_[sensor.attribute("id").as_string()] = read_sensor(sensor, file_);
    chunk_ = transform_of(chunk, file_ + ": transform of the chunk").value_or(Transform{});
    for (const pugi::xml_node& component : chunk.child("components").children("component"))
      if (const auto transform = transform_of(component, file_ + ": transform of a component"))
        components_[component.attribute("id").as_string()] = *transform;
    for_each_camera(chunk.child("cameras"), [&](const pugi::xml_node& camera) { read_camera(camera); });
  }

  std::vector<StatedView> views;

 private:
  void read_camera(const pugi::xml_node& camera) {
    const std::string label = camera.attribute("label").as_string();
    const std::string where = fmt::format("{}: camera '{}'", file_, label);
    const auto text = text_of(camera, "transform");
    if (!enabled(camera)) return report_.skip(label, "the camera is disabled in Metashape");
    if (!text && camera.attribute("master_id"))
      return report_.skip(label, "it belongs to a rig of several cameras, whose poses are not supported");
    if (!text) return report_.skip(label, "Metashape has not aligned it");
    const auto sensor = sensors_.find(camera.attribute("sensor_id").as_string());
    if (sensor == sensors_.end())
      fail(ErrorKind::data, "{}: there is no sensor with the number '{}'", where,
           camera.attribute("sensor_id").as_string());
    if (!sensor->second.unusable.empty()) return report_.skip(label, sensor->second.unusable);
    const std::vector<double> m = numbers_in(*text, 16, where + ": transform");
    const auto component = components_.find(camera.attribute("component_id").as_string());
    const Transform& to_world = component == components_.end() ? chunk_ : component->second;
    std::array<double, 9> rotation{};
    std::array<double, 3> position = to_world.translation;
    for (std::size_t r = 0; r < 3; ++r)
      for (std::size_t k = 0; k < 3; ++k) {
        for (std::size_t c = 0; c < 3; ++c)
          rotation[3 * r + c] += to_world.rotation[3 * r + k] * m[4 * k + c];
        position[r] += to_world.scale * to_world.rotation[3 * r + k] * m[4 * k + 3];
      }
    const Lens& lens = sensor->second.lens;
    views.push_back({{label, where},
                     pose_from_world(rotation, position, CameraAxes::y_down_z_forward, where),
                     sensor->second.size,
                     [lens](ImageSize) { return lens; }});
  }

  std::string file_;
  LoadReport& report_;
  std::map<std::string, Sensor> sensors_;
  std::map<std::string, Transform> components_;
  Transform chunk_;
};

bool is_metashape(const fs::path& file) {
  const std::string start = start_of_file(file);
  return start.find("<document") != std::string::npos && start.find("<chunk") != std::string::npos;
}

}  // namespace

std::vector<std::string> metashape_files(const fs::path& path) {
  std::vector<std::string> names;
  if (is_regular(path)) {
    if (small_extension(path) == ".xml" && is_metashape(path)) names.push_back(path.string());
  } else {
    for (const fs::path& file : matching_paths(path, "*.xml"))
      if (is_metashape(file)) names.push_back(file.filename().string());
  }
  return names;
}

LoadedScene load_metashape(const fs::path& path, const DatasetOptions& options) {
  LoadedScene scene;
  DataRoot root(path, options.read.allow_outside);
  const std::vector<std::string> files = metashape_files(path);
  if (files.empty()) fail(ErrorKind::data, "{}: contains no cameras of Metashape (*.xml)", path.string());
  const fs::path folder = is_folder(path) ? path : path.parent_path();
  const fs::path file = is_folder(path) ? folder / files.front() : path;
  if (files.size() > 1)
    scene.report.note_difference(
        fmt::format("{} files with cameras of Metashape ({}): {} is used; to use another "
                    "one, pass the file",
                    files.size(), fmt::join(files, ", "), files.front()));
  const std::string text = read_text_file(root.check(file));
  pugi::xml_document document;
  if (const auto result = document.load_buffer(text.data(), text.size()); !result)
    fail(ErrorKind::data, "{}: malformed XML at byte {}: {}", file.string(), result.offset,
         result.description());
  pugi::xml_node used;
  std::size_t chunks = 0;
  for (const pugi::xml_node& chunk : document.child("document").children("chunk")) {
    if (count_aligned(chunk) == 0 || !enabled(chunk)) continue;
    if (++chunks == 1 || count_aligned(chunk) > count_aligned(used)) used = chunk;
  }
  if (!used) fail(ErrorKind::data, "{}: no chunk has aligned cameras", file.string());
  if (chunks > 1)
    scene.report.note_difference(fmt::format("{} chunks have cameras: only '{}', which has the most, is used",
                                             chunks, used.attribute("label").as_string()));
  const ChunkReader reader(used, file.string(), scene.report);
  if (reader.views.empty())
    fail(ErrorKind::data, "{}: no camera can be used: {}", file.string(), scene.report.skipped.front().why);
  const ImageFolder images =
      find_image_folder(folder, options, root, reader.views[0].image.name, {"images", "."});
  add_stated_views(scene, folder, images, reader.views, root, options);
  return scene;
}

}  // namespace ubs
