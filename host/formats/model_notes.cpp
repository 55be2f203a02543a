// SPDX-License-Identifier: Apache-2.0
// See model_notes.hpp.
#include "host/formats/model_notes.hpp"

#include <algorithm>
#include <charconv>
#include <optional>
#include <sstream>

#include "host/base/error.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {
namespace {

constexpr std::string_view kDrawn = "ubs_drawn ", kLens = "ubs_lens ", kCamera = "ubs_camera ",
                           kUp = "ubs_up ";

// Returns the numbers of a comment, which follow the key `words`. Throws unless there are exactly `count`
// numbers and nothing else, and unless the absolute value of each number is at most kMaxMagnitude.
std::vector<double> numbers(const std::string& comment, std::string_view words, std::size_t count,
                            const std::string& name) {
  std::istringstream stream(comment.substr(words.size()));
  std::vector<double> values;
  for (std::string word; stream >> word;) {
    // strtod() is not used, because a program that uses the library may have set a locale with decimal
    // commas.
    const char* const end = word.data() + word.size();
    double& value = values.emplace_back();
    const auto result = std::from_chars(word.data(), end, value);
    if (result.ec != std::errc() || result.ptr != end || !(std::abs(value) <= kMaxMagnitude)) values.clear();
    if (values.empty()) break;
  }
  if (values.size() != count)
    fail(ErrorKind::data, "{}: comment '{}' must contain {} numbers", name, comment.substr(0, 80), count);
  return values;
}

bool is_of_drawing(std::string_view key) {
  return std::ranges::any_of(train_fields(), [&](const Field<TrainSettings>& field) {
    return key == field.key && (field.uses & kOfDrawing);
  });
}

void take_settings(const std::string& comment, ModelNotes& notes, const std::string& name) {
  std::istringstream stream(comment.substr(kDrawn.size()));
  for (std::string word; stream >> word;) {
    const std::size_t equals = word.find('=');
    if (equals == std::string::npos)
      fail(ErrorKind::data, "{}: comment '{}' must contain settings of the form key=value", name,
           comment.substr(0, 80));
    if (std::string key = word.substr(0, equals); is_of_drawing(key))
      notes.drawing.emplace_back(std::move(key), word.substr(equals + 1));
  }
}

Camera lens_of(const std::vector<double>& v, const std::string& where) {
  for (const double pixels : {v[0], v[1]})
    if (!(pixels >= 1 && pixels <= kMaxPixelsAcross && pixels == std::floor(pixels)))
      fail(ErrorKind::data,
           "{}: an image side of {} pixels is not possible: it must be an integer from 1 to {}", where,
           pixels, kMaxPixelsAcross);
  Camera camera;
  camera.width = static_cast<int>(v[0]);
  camera.height = static_cast<int>(v[1]);
  camera.fx = v[2];
  camera.fy = v[3];
  camera.cx = 0.5 * v[0];
  camera.cy = 0.5 * v[1];
  return camera;
}

Camera camera_of(const std::vector<double>& v, Camera camera, const std::string& where) {
  const double length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2] + v[3] * v[3]);
  if (!(length > 0.5 && length < 2)) fail(ErrorKind::data, "{}: the quaternion is not a rotation", where);
  camera.rotation = matrix({v[0] / length, v[1] / length, v[2] / length, v[3] / length});
  camera.translation = -1.0 * rotated(camera.rotation, {v[4], v[5], v[6]});
  camera.time = v[7];
  check_camera(camera, where);
  return camera;
}

}  // namespace

ModelNotes make_notes(std::vector<std::pair<std::string, std::string>> drawing,
                      std::span<const Camera> cameras) {
  return {std::move(drawing), evenly_chosen(cameras, kNotedCameras)};
}

std::vector<std::string> comments_of(const ModelNotes& notes) {
  std::vector<std::string> lines;
  if (!notes.drawing.empty()) {
    std::string& line = lines.emplace_back(kDrawn);
    for (const auto& [key, value] : notes.drawing)
      line += fmt::format("{}{}={}", line.size() > kDrawn.size() ? " " : "", key, value);
  }
  if (!notes.cameras.empty()) {
    const Camera& c = notes.cameras.front();
    lines.push_back(fmt::format("{}{} {} {:.7g} {:.7g}", kLens, c.width, c.height, c.fx, c.fy));
  }
  for (const Camera& camera : notes.cameras) {
    const Quaternion q = quaternion(camera.rotation);
    const std::array<double, 3> at = camera.centre();
    lines.push_back(fmt::format("{}{:.7g} {:.7g} {:.7g} {:.7g} {:.7g} {:.7g} {:.7g} {:.7g}", kCamera, q.w,
                                q.x, q.y, q.z, at[0], at[1], at[2], camera.time));
  }
  if (notes.up)
    lines.push_back(
        fmt::format("{}{:.7g} {:.7g} {:.7g}", kUp, (*notes.up)[0], (*notes.up)[1], (*notes.up)[2]));
  return lines;
}

ModelNotes notes_of(std::span<const std::string> comments, const std::string& name) {
  ModelNotes notes;
  std::optional<Camera> lens;
  for (const std::string& comment : comments) {
    const std::string where = fmt::format("{}: comment '{}'", name, comment.substr(0, 80));
    if (comment.starts_with(kDrawn)) take_settings(comment, notes, name);
    if (comment.starts_with(kLens)) lens = lens_of(numbers(comment, kLens, 4, name), where);
    if (comment.starts_with(kUp)) {
      const std::vector<double> v = numbers(comment, kUp, 3, name);
      notes.up = Vec3{v[0], v[1], v[2]};
      if (!(length(*notes.up) > 1e-9)) fail(ErrorKind::data, "{}: the vector has no direction", where);
    }
    if (!comment.starts_with(kCamera)) continue;
    if (!lens) fail(ErrorKind::data, "{}: this comment must come after the comment {}", where, kLens);
    notes.cameras.push_back(camera_of(numbers(comment, kCamera, 8, name), *lens, where));
  }
  return notes;
}

}  // namespace ubs
