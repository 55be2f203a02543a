// SPDX-License-Identifier: Apache-2.0
// Scene is the interface of the built-in procedural scenes, from which host/dataset/synthetic.cpp renders
// images. A scene computes the light along one ray.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <string>

#include "host/scene/vec3.hpp"

namespace ubs::synthetic {

struct Ray {
  Vec3 origin, direction;  // direction of length 1
};

// Sample is the light along a ray.
struct Sample {
  Vec3 colour;  // premultiplied with alpha, in [0,1]
  double alpha = 0;
};

class Scene {
 public:
  virtual ~Scene() = default;
  virtual bool dynamic() const { return false; }
  virtual double focus_height() const { return 0; }  // the cameras look at (0, 0, focus_height)
  // Returns the light along a ray. `u`, `v` in [0,1) are the position of the ray within its pixel. Scenes
  // that also integrate over something else, such as an area light, use `u` and `v` to choose a point of the
  // light. All pixels use the same values of `u` and `v`, so the image has no noise.
  virtual Sample trace(const Ray& ray, double time, double u, double v) const = 0;
};

std::unique_ptr<Scene> make_glossy();
std::unique_ptr<Scene> make_orbit();
std::unique_ptr<Scene> make_cloud(std::uint64_t seed);

inline double smoothstep(double low, double high, double x) {
  const double t = std::fmin(1.0, std::fmax(0.0, (x - low) / (high - low)));
  return t * t * (3 - 2 * t);
}

inline Vec3 mix(const Vec3& a, const Vec3& b, double t) { return a * (1 - t) + b * t; }

inline Vec3 clamp01(const Vec3& c) {
  return {std::fmin(1.0, std::fmax(0.0, c[0])), std::fmin(1.0, std::fmax(0.0, c[1])),
          std::fmin(1.0, std::fmax(0.0, c[2]))};
}

}  // namespace ubs::synthetic
