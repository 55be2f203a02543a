// SPDX-License-Identifier: Apache-2.0
// A camera as JSON: the members of Camera by name.
#pragma once

#include "host/base/json.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

Json camera_json(const Camera& camera);
// Throws Error(data) if a member is missing or of another kind. Of values it checks only that sizes are whole
// numbers up to kMaxPixelsAcross; check_camera() checks the others.
Camera camera_of(const Json& json);

}  // namespace ubs
