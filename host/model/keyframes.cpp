// SPDX-License-Identifier: Apache-2.0
#include "host/model/keyframes.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numbers>

#include "host/base/error.hpp"
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

}  // namespace

KeyframeFile read_keyframes(const std::filesystem::path& path, const KeyframeDefaults& defaults) {
  const Json json = frames::parse_file(path, "keyframes");
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
