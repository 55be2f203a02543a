// SPDX-License-Identifier: Apache-2.0
// See camera_json.hpp.
#include "host/scene/camera_json.hpp"

namespace ubs {

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
  Camera c;
  c.rotation = json.at("rotation").get<std::array<double, 9>>();
  c.translation = json.at("translation").get<std::array<double, 3>>();
  json.at("fx").get_to(c.fx), json.at("fy").get_to(c.fy);
  json.at("cx").get_to(c.cx), json.at("cy").get_to(c.cy);
  json.at("width").get_to(c.width), json.at("height").get_to(c.height);
  json.at("time").get_to(c.time), json.at("extra").get_to(c.extra);
  return c;
}

}  // namespace ubs
