// SPDX-License-Identifier: Apache-2.0
#include "host/scene/synthetic_tracer.hpp"

#include <algorithm>
#include <limits>
#include <optional>

namespace ubs::synthetic {

namespace {

// Maximum number of reflections, after which the environment is used. With 10 instead of 4, one pixel in 1000
// of `glossy` changes.
constexpr int kMaxBounces = 4;
// Secondary rays start slightly above their surface, so that they do not hit it again.
constexpr double kOffset = 1e-6;
const Vec3 kLightCentre(1.8, -2.2, 3.6), kLightU(0.5, 0.4, 0), kLightV(-0.35, 0.3, 0.35);
const Vec3 kFillDirection = normalize(Vec3(-0.7, 0.5, 0.6));  // weak second light without shadow

struct Hit {
  double distance = std::numeric_limits<double>::infinity();
  Vec3 normal, local;  // local: position in the frame of the shape
  const Shape* shape = nullptr;
};

Vec3 turn(const Vec3& p, double yaw) {
  const double c = std::cos(yaw), s = std::sin(yaw);
  return {c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]};
}

void intersect_sphere(const Shape& shape, const Ray& ray, Hit& hit) {
  const Vec3 to_origin = ray.origin - shape.centre;
  const double b = to_origin.dot(ray.direction), c = to_origin.dot(to_origin) - shape.half[0] * shape.half[0];
  const double discriminant = b * b - c;
  if (discriminant < 0) return;
  const double root = std::sqrt(discriminant);
  const double distance = -b - root > kOffset ? -b - root : -b + root;
  if (distance <= kOffset || distance >= hit.distance) return;
  const Vec3 local = to_origin + ray.direction * distance;
  hit = {distance, local * (1 / shape.half[0]), turn(local, -shape.yaw) * (1 / shape.half[0]), &shape};
}

// Intersects a box by the slab method, in the frame of the box.
void intersect_box(const Shape& shape, const Ray& ray, Hit& hit) {
  const Vec3 origin = turn(ray.origin - shape.centre, -shape.yaw),
             direction = turn(ray.direction, -shape.yaw);
  double near = -std::numeric_limits<double>::infinity(), far = -near;
  int axis = 0;
  for (int k = 0; k < 3; ++k) {
    const double inverse = 1 / (std::abs(direction[k]) > 1e-12 ? direction[k] : 1e-12);
    const double a = (-shape.half[k] - origin[k]) * inverse, b = (shape.half[k] - origin[k]) * inverse;
    if (std::min(a, b) > near) {
      near = std::min(a, b);
      axis = k;
    }
    far = std::min(far, std::max(a, b));
  }
  if (near > far || near <= kOffset || near >= hit.distance) return;  // rays never start inside a box
  Vec3 normal(0, 0, 0);
  normal[axis] = direction[axis] > 0 ? -1 : 1;
  hit = {near, turn(normal, shape.yaw), origin + direction * near, &shape};
}

Hit intersect(const std::vector<Shape>& shapes, const Ray& ray) {
  Hit hit;
  for (const Shape& shape : shapes)
    shape.kind == Shape::Kind::sphere ? intersect_sphere(shape, ray, hit) : intersect_box(shape, ray, hit);
  return hit;
}

bool in_shadow(const std::vector<Shape>& shapes, const Vec3& from, const Vec3& to) {
  const Vec3 path = to - from;
  const double length = norm(path);
  return intersect(shapes, {from, path * (1 / length)}).distance < length;
}

// Returns the light that arrives from the direction `d` if there is no object. The environment is a dark
// studio with a bright panel at the ceiling, a window and a warm horizon.
Vec3 environment(const Vec3& d) {
  Vec3 sky = mix(Vec3(0.34, 0.27, 0.22), Vec3(0.10, 0.16, 0.30), smoothstep(-0.1, 0.8, d[2]));
  if (d[2] < 0) sky = mix(sky, Vec3(0.05, 0.05, 0.06), smoothstep(0, -0.5, d[2]));
  const double height = std::max(d[2], 1e-3);
  const double px = d[0] / height, py = d[1] / height;  // where the ray meets a ceiling at height 1
  const double panel =
      smoothstep(0.62, 0.52, std::abs(px - 0.5)) * smoothstep(0.40, 0.30, std::abs(py + 0.6));
  const double azimuth = std::atan2(d[1], d[0]);
  const double window = smoothstep(0.34, 0.26, std::abs(azimuth - 2.4)) *
                        smoothstep(0.26, 0.20, std::abs(d[2] - 0.36)) *
                        (0.25 + 0.75 * smoothstep(0.02, 0.05, std::abs(azimuth - 2.4)));
  if (d[2] > 0) sky += Vec3(1.0, 0.96, 0.88) * (1.3 * panel);
  return sky + Vec3(0.65, 0.80, 1.0) * window;
}

// Returns the colour of a checkerboard. It has thin dark lines between the cells, and its tint varies slowly,
// so that all cells look different.
Vec3 checker(const Material& m, double x, double y) {
  const double cx = x * m.frequency, cy = y * m.frequency;
  const long ix = std::lround(std::floor(cx)), iy = std::lround(std::floor(cy));
  const double fx = cx - static_cast<double>(ix), fy = cy - static_cast<double>(iy);
  const double edge = std::min(std::min(fx, 1 - fx), std::min(fy, 1 - fy));
  Vec3 colour = (ix + iy) % 2 == 0 ? m.colour : m.colour2;
  colour =
      mix(colour, Vec3(0.75, 0.45, 0.25), 0.22 * (1 + std::sin(2.1 * x + 1.3 * y + 3 * std::sin(1.7 * y))));
  if ((ix + iy) % 2 == 0) colour *= 0.82 + 0.18 * std::sin(26 * std::hypot(fx - 0.5, fy - 0.5));  // rings
  return colour * (0.55 + 0.45 * smoothstep(0.015, 0.05, edge));
}

Vec3 albedo(const Hit& hit) {
  const Material& m = hit.shape->material;
  if (m.texture == Texture::plain) return m.colour;
  if (m.texture == Texture::checker) {
    if (hit.shape->kind == Shape::Kind::box) return checker(m, hit.local[0], hit.local[1] + hit.local[2]);
    const double azimuth = std::atan2(hit.local[1], hit.local[0]);
    return checker(m, azimuth / 3.14159265358979,
                   std::asin(std::clamp(hit.local[2], -1.0, 1.0)) / 3.14159265358979);
  }
  const double wave = std::sin(2 * 3.14159265358979 * m.frequency * hit.local[2] + 2 * hit.local[0]);
  return mix(m.colour, m.colour2, smoothstep(-0.15, 0.15, wave));
}

class Tracer {
 public:
  Tracer(const std::vector<Shape>& shapes, double u, double v)
      : shapes_(shapes), light_(kLightCentre + kLightU * (2 * u - 1) + kLightV * (2 * v - 1)) {}

  std::optional<Vec3> radiance(const Ray& ray, int bounce) const {
    const Hit hit = intersect(shapes_, ray);
    if (!hit.shape) return std::nullopt;
    const Vec3 point = ray.origin + ray.direction * hit.distance + hit.normal * (2 * kOffset);
    const Vec3 mirrored = ray.direction - hit.normal * (2 * ray.direction.dot(hit.normal));
    return local_light(hit, point, mirrored) + reflection(hit, {point, mirrored}, bounce);
  }

 private:
  Vec3 local_light(const Hit& hit, const Vec3& point, const Vec3& mirrored) const {
    const Material& m = hit.shape->material;
    const Vec3 base = albedo(hit) * m.diffuse;
    const Vec3 to_light = normalize(light_ - point);
    const double facing = hit.normal.dot(to_light);
    const double lit = facing > 0 && !in_shadow(shapes_, point, light_) ? 1.0 : 0.0;
    const double fill = 0.22 * std::max(0.0, hit.normal.dot(kFillDirection));
    Vec3 light = Vec3(0.20, 0.22, 0.26) * (0.75 + 0.25 * hit.normal[2]) + Vec3(0.75, 0.85, 1.0) * fill +
                 Vec3(1.0, 0.95, 0.86) * (0.78 * lit * std::max(0.0, facing));
    const double phong = lit * m.highlight * std::pow(std::max(0.0, mirrored.dot(to_light)), m.shininess);
    return base.mul(light) + Vec3(1.0, 0.97, 0.92) * phong;
  }

  // Returns the reflected light. Its strength follows Schlick's approximation of the Fresnel factor.
  Vec3 reflection(const Hit& hit, const Ray& ray, int bounce) const {
    const Vec3& normal_incidence = hit.shape->material.mirror;
    if (normal_incidence == Vec3(0, 0, 0)) return {0, 0, 0};
    const double grazing = std::pow(1 - std::clamp(ray.direction.dot(hit.normal), 0.0, 1.0), 5);
    const Vec3 strength = normal_incidence + (Vec3(1, 1, 1) - normal_incidence) * (0.8 * grazing);
    const auto seen = bounce < kMaxBounces ? radiance(ray, bounce + 1) : std::nullopt;
    return strength.mul(seen ? clamp01(*seen) : environment(ray.direction));
  }

  const std::vector<Shape>& shapes_;
  Vec3 light_;
};

}  // namespace

Sample trace_shapes(const std::vector<Shape>& shapes, const Ray& ray, double u, double v) {
  const auto colour = Tracer(shapes, u, v).radiance(ray, 0);
  return colour ? Sample{clamp01(*colour), 1.0} : Sample{};
}

}  // namespace ubs::synthetic
