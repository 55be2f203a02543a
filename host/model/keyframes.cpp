// SPDX-License-Identifier: Apache-2.0
#include "host/model/keyframes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/dataset/frames_json.hpp"

namespace ubs {
namespace {

using frames::Node;

constexpr double kDegree = std::numbers::pi / 180;

// Throws Error(data) for unknown fields, because a misspelt field would otherwise be silently ignored.
void check_fields(const Json& object, const std::string& where, std::initializer_list<const char*> known) {
  for (const auto& [key, value] : object.items())
    if (std::ranges::find(known, key) == known.end())
      fail(ErrorKind::data, "{}: unknown field '{}': expected one of {}", where, key, fmt::join(known, ", "));
}

Pose looking_pose(const Node& node, const KeyframeDefaults& defaults) {
  const Vec3 position = node.vector("position"), target = node.vector("look_at");
  const Vec3 up = node.has("up") ? Vec3(node.vector("up")) : defaults.up;
  if (!(length(target - position) > 1e-9))
    fail(ErrorKind::data, "{}: 'look_at' must differ from the position of the camera", node.where);
  if (!(length(cross(normalised(up), normalised(target - position))) > 1e-6))
    fail(ErrorKind::data, "{}: 'up' must not be zero or parallel to the view direction", node.where);
  return look_at(position, target, up);
}

Pose read_pose(const Node& node, const KeyframeDefaults& defaults) {
  check_fields(node.json, node.where,
               {"position", "look_at", "up", "world_to_camera", "transform_matrix", "fov", "time"});
  const int forms = node.has("position") + node.has("world_to_camera") + node.has("transform_matrix");
  if (forms != 1)
    fail(ErrorKind::data,
         "{}: needs exactly one of 'position' (with 'look_at'), 'world_to_camera' and 'transform_matrix'",
         node.where);
  Pose pose;
  if (node.has("position")) {
    pose = looking_pose(node, defaults);
  } else {
    for (const char* other : {"look_at", "up"})
      if (node.has(other)) fail(ErrorKind::data, "{}: '{}' requires 'position'", node.where, other);
    Camera camera;
    if (node.has("world_to_camera"))
      frames::set_world_to_camera(camera, node);
    else
      frames::set_pose(camera, node);
    pose = pose_of(camera);
  }
  pose.position = pose.position - defaults.offset;
  const double degrees = node.has("fov") ? node.number("fov") : defaults.fov / kDegree;
  if (!(degrees > 0.1 && degrees < 179))
    fail(ErrorKind::data, "{}: 'fov' = {} must be between 0.1 and 179 degrees", node.where, degrees);
  pose.fov = degrees * kDegree;
  pose.time = node.has("time") ? node.number("time") : 0.0;
  return pose;
}

// Returns the elements of an array of numbers.
std::vector<double> numbers_of(const Node& node, const char* key, std::size_t count) {
  const Json& values = node.has(key) ? node.json[key] : Json();
  std::vector<double> numbers;
  if (values.is_array())
    for (const Json& value : values)
      if (value.is_number()) numbers.push_back(value.get<double>());
  if (numbers.size() != count || values.size() != count)
    fail(ErrorKind::data, "{}: '{}' must be {} numbers", node.where, key, count);
  return numbers;
}

// Returns the horizontal angle of view of an image whose width is `aspect` times its height. All angles are
// in degrees.
double horizontal_degrees(double vertical, double aspect) {
  return 2 / kDegree * std::atan(std::tan(vertical * kDegree / 2) * aspect);
}

double positive_number(const Node& node, const char* key) {
  if (!node.has(key)) fail(ErrorKind::data, "{}: '{}' is missing", node.where, key);
  const double value = node.number(key);
  if (!(value > 0)) fail(ErrorKind::data, "{}: '{}' = {} must be positive", node.where, key, value);
  return value;
}

const Json& member(const Json& json, const char* key, Json::value_t type, const std::string& where) {
  if (!json.is_object() || !json.contains(key) || json[key].type() != type || json[key].empty())
    fail(ErrorKind::data, "{}: '{}' is missing, empty or of another type", where, key);
  return json[key];
}

// In a path of nerfstudio, the angles of view are vertical.
Json from_nerfstudio(const Json& path, const std::string& where) {
  const Node file{path, where};
  if (file.has("camera_type") && file.text("camera_type") != "perspective")
    fail(ErrorKind::data, "{}: only paths with 'camera_type' perspective can be rendered", where);
  Json result{{"closed", file.flag("is_cycle")}, {"keyframes", Json::array()}};
  double aspect = 0;
  if (file.has("render_width") && file.has("render_height"))
    aspect = positive_number(file, "render_width") / positive_number(file, "render_height");
  for (const Json& camera : member(path, "camera_path", Json::value_t::array, where)) {
    const Node node{camera, fmt::format("{}: camera {}", where, result["keyframes"].size())};
    const std::vector<double> m = numbers_of(node, "camera_to_world", 16);
    Json matrix = Json::array();
    for (std::size_t row = 0; row < 4; ++row)
      matrix.push_back({m[4 * row], m[4 * row + 1], m[4 * row + 2], m[4 * row + 3]});
    Json& keyframe = result["keyframes"].emplace_back(Json{{"transform_matrix", matrix}});
    const double across = node.has("aspect") && aspect == 0 ? node.number("aspect") : aspect;
    if (node.has("fov") && across > 0) keyframe["fov"] = horizontal_degrees(node.number("fov"), across);
    if (node.has("render_time")) keyframe["time"] = node.number("render_time");
  }
  return result;
}

// The rotations of 3DGS are camera-to-world, and its cameras have z forward.
Json from_3dgs(const Json& cameras, const std::string& where) {
  Json result{{"keyframes", Json::array()}};
  for (const Json& camera : cameras) {
    const Node node{camera, fmt::format("{}: camera {}", where, result["keyframes"].size())};
    if (!camera.is_object()) fail(ErrorKind::data, "{}: must be an object", node.where);
    const std::array<double, 3> position = node.vector("position");
    const Json& rows = member(camera, "rotation", Json::value_t::array, node.where);
    Json matrix = Json::array();
    for (std::size_t r = 0; r < 3; ++r) {
      const Json row{{"row", r < rows.size() ? rows[r] : Json()}};
      const std::array<double, 3> v = Node{row, node.where + ": 'rotation'"}.vector("row");
      matrix.push_back({v[0], -v[1], -v[2], position[r]});
    }
    result["keyframes"].push_back(
        {{"transform_matrix", matrix},
         {"fov",
          2 / kDegree * std::atan(positive_number(node, "width") / (2 * positive_number(node, "fx")))}});
  }
  return result;
}

// SuperSplat rotates models by 180 degrees about z, so that y points up.
Json from_supersplat(const Json& settings, const std::string& where) {
  const Json& track = member(settings, "animTracks", Json::value_t::array, where)[0];
  const Json& frames = member(track, "keyframes", Json::value_t::object, where + ": animTracks[0]");
  const std::string at = where + ": animTracks[0]: keyframes";
  const Node values{member(frames, "values", Json::value_t::object, at), at + ": values"};
  const std::size_t count = member(frames, "times", Json::value_t::array, at).size();
  const std::vector<double> positions = numbers_of(values, "position", 3 * count);
  const std::vector<double> targets = numbers_of(values, "target", 3 * count);
  std::vector<double> angles;
  if (values.has("fov")) angles = numbers_of(values, "fov", count);
  const Json camera = settings.contains("camera") ? settings["camera"] : Json();
  if (angles.empty() && camera.contains("fov"))
    angles.assign(count, Node{camera, where + ": camera"}.number("fov"));
  const bool closed = track.contains("loopMode") && track["loopMode"] == "repeat";
  Json result{{"closed", closed}, {"keyframes", Json::array()}};
  for (std::size_t i = 0; i < count; ++i) {
    Json& keyframe = result["keyframes"].emplace_back(
        Json{{"position", {-positions[3 * i], -positions[3 * i + 1], positions[3 * i + 2]}},
             {"look_at", {-targets[3 * i], -targets[3 * i + 1], targets[3 * i + 2]}},
             {"up", {0, -1, 0}}});
    if (!angles.empty()) keyframe["fov"] = angles[i];
  }
  return result;
}

// Reads the file as keyframes, which may be converted from a path of another program.
Json read_json(const std::filesystem::path& path) {
  Json json;
  try {
    json = parse_json(read_text_file(path), path.string());
  } catch (const Error&) {  // parse_file() also explains numbers that are not finite
    return frames::parse_file(path, "keyframes");
  }
  if (json.is_array() && !json.empty()) return from_3dgs(json, path.string());
  if (json.is_object() && json.contains("camera_path")) return from_nerfstudio(json, path.string());
  if (json.is_object() && json.contains("animTracks")) return from_supersplat(json, path.string());
  return frames::parse_file(path, "keyframes");
}

}  // namespace

KeyframeFile read_keyframes(const std::filesystem::path& path, const KeyframeDefaults& defaults) {
  const Json json = read_json(path);
  check_fields(json, path.string(), {"closed", "keyframes"});
  KeyframeFile file;
  if (json.contains("closed")) {
    if (!json["closed"].is_boolean())
      fail(ErrorKind::data, "{}: 'closed' must be true or false", path.string());
    file.closed = json["closed"].get<bool>();
  }
  std::size_t times = 0;
  for (std::size_t i = 0; i < json["keyframes"].size(); ++i) {
    const Node node{json["keyframes"][i], fmt::format("{}: keyframe {}", path.string(), i)};
    file.poses.push_back(read_pose(node, defaults));
    times += node.has("time");
  }
  if (times != 0 && times != file.poses.size())
    fail(ErrorKind::data, "{}: {} of {} keyframes have a 'time': either all keyframes or none must have it",
         path.string(), times, file.poses.size());
  file.has_time = times > 0;
  return file;
}

}  // namespace ubs
