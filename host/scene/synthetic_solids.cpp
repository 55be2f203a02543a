// SPDX-License-Identifier: Apache-2.0
// This file contains the scenes `glossy` and `orbit`. All objects are inside [-1.3, 1.3]^3, the cube that the
// random initialisation fills.
#include <numbers>

#include "host/scene/synthetic_tracer.hpp"

namespace ubs::synthetic {

namespace {

constexpr double kFloor = -0.62;  // height of the upper side of the slab
constexpr double kFocus = -0.3;   // height of the middle of the objects on the slab

Shape slab(double half_width, const Vec3& light, const Vec3& dark, double mirror) {
  Material m;
  m.texture = Texture::checker;
  m.frequency = 3.2;
  m.colour = light;
  m.colour2 = dark;
  m.mirror = Vec3::all(mirror);
  return {Shape::Kind::box, {0, 0, kFloor - 0.05}, {half_width, half_width, 0.05}, 0, m};
}

Material plastic(const Vec3& colour) {
  Material m;
  m.colour = colour;
  m.highlight = 0.7;
  m.shininess = 90;
  m.mirror = Vec3::all(0.04);
  return m;
}

Material metal(const Vec3& tint) {
  Material m;
  m.colour = tint;
  m.diffuse = 0.18;
  m.highlight = 0.6;
  m.shininess = 40;
  m.mirror = tint * 0.8;
  return m;
}

Shape ball(double radius, double x, double y, const Material& material) {
  return {Shape::Kind::sphere, {x, y, kFloor + radius}, Vec3::all(radius), 0, material};
}

class Glossy : public Scene {
 public:
  Glossy() {
    shapes_.push_back(slab(0.98, {0.86, 0.82, 0.72}, {0.10, 0.30, 0.34}, 0.06));
    shapes_.push_back(ball(0.46, -0.36, 0.22, metal({0.95, 0.96, 0.98})));
    const double half = 0.30;
    shapes_.push_back(
        {Shape::Kind::box, {0.50, 0.30, kFloor + 0.36}, {half, 0.22, 0.36}, 0.5, metal({1.0, 0.76, 0.36})});
    shapes_.push_back(ball(0.21, 0.16, -0.46, plastic({0.78, 0.08, 0.07})));
    shapes_.push_back(ball(0.15, -0.42, -0.62, plastic({0.06, 0.22, 0.75})));
    Material striped = plastic({0.92, 0.90, 0.86});
    striped.texture = Texture::stripes;
    striped.colour2 = {0.10, 0.45, 0.16};
    striped.frequency = 2.5;
    shapes_.push_back(ball(0.19, 0.68, -0.52, striped));
  }
  double focus_height() const override { return kFocus; }
  Sample trace(const Ray& ray, double, double u, double v) const override {
    return trace_shapes(shapes_, ray, u, v);
  }

 private:
  std::vector<Shape> shapes_;
};

class Orbit : public Scene {
 public:
  bool dynamic() const override { return true; }
  double focus_height() const override { return kFocus; }
  Sample trace(const Ray& ray, double time, double u, double v) const override {
    return trace_shapes(shapes_at(time), ray, u, v);
  }

 private:
  static std::vector<Shape> shapes_at(double t) {
    constexpr double pi = std::numbers::pi;
    std::vector<Shape> shapes{slab(0.98, {0.80, 0.80, 0.78}, {0.28, 0.30, 0.36}, 0.0)};

    Material changing = plastic(mix({0.10, 0.25, 0.80}, {0.95, 0.50, 0.06}, smoothstep(0.1, 0.9, t)));
    shapes.push_back({Shape::Kind::box, {0, 0, kFloor + 0.32}, {0.22, 0.22, 0.32}, pi * t, changing});

    Material spotted = plastic({0.85, 0.12, 0.10});
    spotted.texture = Texture::checker;
    spotted.colour2 = {0.95, 0.88, 0.75};
    Shape orbiting = ball(0.22, 0.64 * std::cos(2 * pi * t), 0.64 * std::sin(2 * pi * t), spotted);
    orbiting.yaw = 4 * pi * t;
    shapes.push_back(orbiting);

    Shape bouncing = ball(0.15, -0.72 + 0.2 * t, -0.74, plastic({0.15, 0.65, 0.25}));
    bouncing.centre[2] += 0.75 * std::abs(std::sin(3 * pi * t));
    shapes.push_back(bouncing);

    const double radius = 0.20 * smoothstep(0.25, 0.45, t) * (1 - smoothstep(0.75, 0.92, t));
    if (radius > 0.002) shapes.push_back(ball(radius, 0.74, -0.76 + 0.1 * t, plastic({0.85, 0.75, 0.10})));
    return shapes;
  }
};

}  // namespace

std::unique_ptr<Scene> make_glossy() { return std::make_unique<Glossy>(); }
std::unique_ptr<Scene> make_orbit() { return std::make_unique<Orbit>(); }

}  // namespace ubs::synthetic
