// SPDX-License-Identifier: Apache-2.0
// camera_json() and camera_of() convert a camera to and from JSON. The JSON members have the same names as
// the members of Camera.
#pragma once

#include "host/base/json.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

Json camera_json(const Camera& camera);
// Converts JSON to a camera. Throws Error(data) if a member is missing or has the wrong type. Image sizes
// must be integers up to kMaxPixelsAcross. Other values are not checked here, but by check_camera().
Camera camera_of(const Json& json);

}  // namespace ubs
