// SPDX-License-Identifier: Apache-2.0
// What synthetic.cpp needs of a procedural scene: the light along one ray. Internal to host/scene.
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

struct Sample {
  Vec3 colour;  // premultiplied with alpha, in [0,1]
  double alpha = 0;
};

class Scene {
 public:
  virtual ~Scene() = default;
  virtual bool dynamic() const { return false; }
  virtual double focus_height() const { return 0; }  // the cameras look at (0, 0, this)
  // `u`, `v` in [0,1): the position of the ray within its pixel. Scenes that integrate over a second
  // domain (an area light) take their sample there: the same for every pixel, so without noise.
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
