// SPDX-License-Identifier: Apache-2.0
// Where to look at a model from when nobody says: medians of the splats, weighted with their opacities, so
// that a few stray ones do not matter. For models without a data set.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "host/scene/camera.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

struct Framing {
  std::array<double, 3> centre{};
  double radius = 1;  // nine tenths of the opacity are nearer to the centre; > 0
  std::array<double, 3> up{0, 0, 1};
};

// The axis that points away from a floor: a quarter of the opacity in a layer at most a third as thick as
// that of the quarter at the other end of the axis. `otherwise` where no axis has one.
std::array<double, 3> guess_up(const MixedModel& model, const std::array<double, 3>& otherwise);

// Centre and radius from the splats. Throws Error(data) for a model without splats.
Framing frame_model(const MixedModel& model, const std::array<double, 3>& up);

// "x", "-y" ... as unit vector. Throws Error(usage) for other texts.
std::array<double, 3> parse_axis(std::string_view text);

// `count` cameras evenly around the up axis, all looking at the centre from `elevation` radians above it, far
// enough for the radius to fit; horizontal angle of view 0.87 rad (50 degrees).
std::vector<Camera> framing_cameras(const Framing& framing, std::size_t count, int width, int height,
                                    double elevation = 0.26);

}  // namespace ubs
