// SPDX-License-Identifier: Apache-2.0
#include "host/scene/camera_json.hpp"

#include <algorithm>

#include "host/base/error.hpp"

namespace ubs {
namespace {

const Json& camera_member(const Json& json, const char* name) {
  const auto found = json.find(name);
  if (found == json.end()) fail(ErrorKind::data, "camera: {} is missing", name);
  return *found;
}

double camera_number(const Json& json, const char* name) {
  const Json& value = camera_member(json, name);
  // is_number() is false for true and false, which get() would convert to 1 and 0.
  if (!value.is_number()) fail(ErrorKind::data, "camera: {} must be a number", name);
  return value.get<double>();
}

// Integers in JSON may exceed the range of int, and a plain conversion would wrap around.
int camera_size(const Json& json, const char* name) {
  const Json& value = camera_member(json, name);
  const bool fits = value.is_number_unsigned()
                        ? value.get<std::uint64_t>() <= kMaxPixelsAcross
                        : value.is_number_integer() && value.get<std::int64_t>() >= 0 &&
                              value.get<std::int64_t>() <= kMaxPixelsAcross;
  if (!fits) fail(ErrorKind::data, "camera: {} must be an integer of at most {}", name, kMaxPixelsAcross);
  return value.get<int>();
}

std::vector<double> camera_numbers(const Json& json, const char* name) {
  const Json& list = camera_member(json, name);
  if (!list.is_array() || !std::all_of(list.begin(), list.end(), [](const Json& v) { return v.is_number(); }))
    fail(ErrorKind::data, "camera: {} must be a list of numbers", name);
  return list.get<std::vector<double>>();
}

template <std::size_t count>
void read_numbers(const Json& json, const char* name, std::array<double, count>& to) {
  const std::vector<double> list = camera_numbers(json, name);
  if (list.size() != count) fail(ErrorKind::data, "camera: {} must have {} numbers", name, count);
  std::copy(list.begin(), list.end(), to.begin());
}

}  // namespace

Json camera_json(const Camera& c) {
  return {{"rotation", c.rotation},
          {"translation", c.translation},
          {"fx", c.fx},
          {"fy", c.fy},
          {"cx", c.cx},
          {"cy", c.cy},
          {"width", c.width},
          {"height", c.height},
          {"time", c.time},
          {"extra", c.extra}};
}

Camera camera_of(const Json& json) {
  if (!json.is_object()) fail(ErrorKind::data, "camera: the value is not a JSON object");
  Camera c;
  read_numbers(json, "rotation", c.rotation);
  read_numbers(json, "translation", c.translation);
  c.fx = camera_number(json, "fx"), c.fy = camera_number(json, "fy");
  c.cx = camera_number(json, "cx"), c.cy = camera_number(json, "cy");
  c.width = camera_size(json, "width"), c.height = camera_size(json, "height");
  c.time = camera_number(json, "time");
  c.extra = camera_numbers(json, "extra");
  return c;
}

}  // namespace ubs
