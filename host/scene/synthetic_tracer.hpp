// SPDX-License-Identifier: Apache-2.0
// trace_shapes() is a small ray tracer for spheres and upright boxes, with Phong highlights, mirror
// reflections, shadows of one area light, and a studio-like environment that is only visible in reflections.
// It is internal to host/scene.
#pragma once

#include <vector>

#include "host/scene/synthetic_scene.hpp"

namespace ubs::synthetic {

enum class Texture { plain, checker, stripes };

struct Material {
  Vec3 colour{0.8, 0.8, 0.8}, colour2{0.2, 0.2, 0.2};
  Texture texture = Texture::plain;
  double frequency = 4;  // texture cells per unit length (per half turn on a sphere)
  double diffuse = 1, highlight = 0, shininess = 60;
  Vec3 mirror{0, 0, 0};  // reflectance at normal incidence; larger at grazing angles; 0: none
};

struct Shape {
  enum class Kind { sphere, box } kind = Kind::sphere;
  Vec3 centre;
  Vec3 half{1, 1, 1};  // box: half extents; sphere: half[0] is the radius
  double yaw = 0;      // rotation about the vertical axis [rad]
  Material material;
};

// Returns the light along a ray. `u` and `v` in [0,1) choose a point of the area light.
Sample trace_shapes(const std::vector<Shape>& shapes, const Ray& ray, double u, double v);

}  // namespace ubs::synthetic
