// SPDX-License-Identifier: Apache-2.0
// This file implements random_case(). Positions of splats are chosen relative to the camera, so that most
// splats are visible. To get the same cases with every compiler, an expression draws at most one random
// number, or the language defines the order in which its operands are evaluated. This order is not defined
// for the arguments of a function.
#include "tests/stress/random_case.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>

#include "host/lab/oracle/scenes.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs::stress {
namespace {

using Vector = std::array<double, 3>;

double as_float(double x) { return static_cast<double>(static_cast<float>(x)); }
double log_uniform(Random& r, double low, double high) {
  return std::exp(r.uniform(std::log(low), std::log(high)));
}
bool chance(Random& r, double probability) { return r.uniform(0, 1) < probability; }
double random_sign(Random& r) { return chance(r, 0.5) ? 1 : -1; }
std::size_t pick(Random& r, std::size_t count) { return static_cast<std::size_t>(r.bits() % count); }

struct Form {
  int dim;
  ModelVariant variant;
};

Form random_form(Random& r) {
  constexpr int kDims[] = {3, 4, 5, 6, 6, 7, 7};
  if (chance(r, 0.85)) return {kDims[pick(r, std::size(kDims))], {}};
  const Form forms[] = {{6, {.cov_mode = CovMode::whiten}},
                        {6, {.conditioning = Conditioning::direct}},
                        {7, {.conditioning = Conditioning::direct}},
                        {3, {.rot_mode = RotMode::quaternion}},
                        {6, {.kernel = SpatialKernel::gaussian, .colour = ColourMode::sh1}}};
  return forms[pick(r, std::size(forms))];
}

void random_size(Random& r, Camera& camera) {
  constexpr int kWide[][2] = {{1, 1}, {17, 3}, {3, 65}, {16, 16}, {8191, 1}, {1, 1031}, {7680, 3}, {33, 31}};
  if (chance(r, 0.12)) {
    const auto& size = kWide[pick(r, std::size(kWide))];
    camera.width = size[0], camera.height = size[1];
  } else {
    camera.width = static_cast<int>(r.uniform(4, 40)), camera.height = static_cast<int>(r.uniform(4, 32));
  }
}

// Sets a rotation that is orthonormal to double precision. The program under test rounds it to float.
void random_rotation(Random& r, Camera& camera) {
  double q[4], length = 0;
  for (double& x : q) x = r.normal(), length += x * x;
  for (double& x : q) x /= std::sqrt(length);
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  camera.rotation = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                     2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                     2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
}

Camera random_camera(Random& r, int dim) {
  Camera camera;
  random_size(r, camera);
  const double size = std::max(camera.width, camera.height);
  camera.fx = as_float(size * (chance(r, 0.9) ? r.uniform(0.5, 2) : log_uniform(r, 0.05, 100)));
  camera.fy = as_float(camera.fx * (chance(r, 0.8) ? r.uniform(0.9, 1.1) : log_uniform(r, 0.1, 10)));
  const double off = chance(r, 0.9) ? 0.1 : 3;
  camera.cx = as_float(camera.width * (0.5 + r.uniform(-off, off)));
  camera.cy = as_float(camera.height * (0.5 + r.uniform(-off, off)));
  if (chance(r, 0.8)) random_rotation(r, camera);
  const double far = chance(r, 0.85) ? 4 : log_uniform(r, 1e3, 1e7);
  Vector centre;
  for (double& x : centre) x = as_float(r.uniform(-far, far));
  for (std::size_t i = 0; i < 3; ++i) {
    camera.translation[i] = 0;
    for (std::size_t k = 0; k < 3; ++k) camera.translation[i] -= camera.rotation[3 * i + k] * centre[k];
  }
  constexpr double kTimes[] = {0, 1, -0.5, 3};
  camera.time = chance(r, 0.8) ? as_float(r.uniform(0, 1)) : kTimes[pick(r, std::size(kTimes))];
  if (dim == 5) camera.extra.push_back(as_float(r.uniform(-1, 1)));
  return camera;
}

// The raw parameters of one splat during its creation.
struct Splat {
  explicit Splat(const ParameterLayout& layout) : l(layout), raw(static_cast<std::size_t>(layout.count)) {}
  double& at(int row) { return raw[static_cast<std::size_t>(row)]; }
  int rotations() const { return l.variant.rot_mode == RotMode::quaternion ? 4 : 3; }
  const ParameterLayout& l;
  std::vector<double> raw;
};

struct Scene {
  const Camera& camera;
  Vector centre;
  float near_plane;
};

// Puts a splat at the depth z and at (slope_x, slope_y) z in the coordinates of the camera.
void place(Splat& s, const Scene& scene, double slope_x, double slope_y, double z) {
  const Vector p{slope_x * z, slope_y * z, z};
  for (int i = 0; i < 3; ++i) {
    s.at(i) = scene.centre[static_cast<std::size_t>(i)];
    for (int k = 0; k < 3; ++k)
      s.at(i) += scene.camera.rotation[static_cast<std::size_t>(3 * k + i)] * p[static_cast<std::size_t>(k)];
  }
}

std::vector<double> query_at(const Splat& s, const Scene& scene) {
  std::vector<double> q;
  if (s.l.query >= 3) {
    Vector w;
    for (std::size_t i = 0; i < 3; ++i) w[i] = s.raw[i] - scene.centre[i];
    const double rho = std::max(1e-12, std::hypot(w[0], w[1], w[2]));
    for (const double x : w) q.push_back(x / rho);
  }
  if (static_cast<int>(q.size()) < s.l.query) q.push_back(scene.camera.time);
  for (std::size_t i = 0; static_cast<int>(q.size()) < s.l.query; ++i) q.push_back(scene.camera.extra[i]);
  return q;
}

// Sets the mean of the query values to the query of the camera, plus random numbers of up to `spread`.
void aim(Splat& s, const Scene& scene, Random& r, double spread) {
  const std::vector<double> q = query_at(s, scene);
  for (int i = 0; i < s.l.query; ++i)
    s.at(s.l.mean + i) = q[static_cast<std::size_t>(i)] + r.uniform(-spread, spread);
}

// Sets all parameters of a splat without extreme properties.
void ordinary(Splat& s, const Scene& scene, Random& r, double depth) {
  const Camera& c = scene.camera;
  const double y = r.uniform(-0.1, 1.1) * c.height, x = r.uniform(-0.1, 1.1) * c.width;
  place(s, scene, (x - c.cx) / c.fx, (y - c.cy) / c.fy, depth);
  const ParameterLayout& l = s.l;
  for (int row = l.rgb; row < l.opacity; ++row)
    s.at(row) = row < l.rgb + 3 ? r.uniform(0, 1) : 0.2 * r.normal();
  s.at(l.opacity) = r.uniform(-3, 3);
  for (int row = l.beta; row < l.mean; ++row) s.at(row) = r.uniform(-1.5, 1);
  // The sizes of splats in the image range from a few pixels to the whole image.
  const double size = depth / c.fx * r.uniform(1, 0.6 * std::max(4, std::min(c.width, c.height)));
  for (int i = 0; i < l.dim; ++i)
    s.at(l.scale + i) = inverse_softplus_of(i < 3 ? size * r.uniform(0.3, 1.5) : r.uniform(0.5, 1.5));
  for (int row = l.l_triangle; row < l.count; ++row)
    s.at(row) = row < l.l_triangle + s.rotations() ? r.uniform(-0.5, 0.5) : 0.3 * size * r.normal();
  aim(s, scene, r, 0.35);
}

// ---- Functions that make one property extreme ----

void extreme_betas(Splat& s, Random& r) {
  for (int row = s.l.beta; row < s.l.mean; ++row)
    if (chance(r, 0.7)) s.at(row) = r.uniform(-12, 12);
}

void extreme_scales(Splat& s, Random& r) {
  for (int i = 0; i < 3; ++i)
    if (chance(r, 0.6)) s.at(s.l.scale + i) = inverse_softplus_of(log_uniform(r, 1e-7, 1e4));
}

void needle(Splat& s, Random& r) {
  const double ratio = log_uniform(r, 10, 1e7);
  const int along = static_cast<int>(pick(r, 3));
  for (int i = 0; i < 3; ++i)
    if (i != along) {
      const double scale = std::log1p(std::exp(s.at(s.l.scale + i)));
      s.at(s.l.scale + i) = inverse_softplus_of(std::max(1e-30, scale / ratio));
    }
}

void large_rotation(Splat& s, Random& r) {
  const double size = log_uniform(r, 0.5, 10);
  for (int i = 0; i < s.rotations(); ++i) s.at(s.l.l_triangle + i) = size * r.uniform(-1, 1);
}

// Sets query scales that are much smaller than the coupling of position and query. The condition number of
// the query covariance Sigma_q is about the square of the ratio.
void coupled_query(Splat& s, Random& r) {
  const double ratio = log_uniform(r, 10, 1e6), size = log_uniform(r, 0.1, 3);
  for (int row = s.l.l_triangle + 3; row < s.l.count; ++row) s.at(row) = size * r.normal();
  for (int i = 3; i < s.l.dim; ++i)
    if (chance(r, 0.7)) s.at(s.l.scale + i) = inverse_softplus_of(size / ratio * r.uniform(0.5, 2));
}

void query_scales(Splat& s, Random& r) {
  for (int i = 3; i < s.l.dim; ++i)
    if (chance(r, 0.6)) s.at(s.l.scale + i) = inverse_softplus_of(log_uniform(r, 1e-6, 1e4));
}

void opacities(Splat& s, Random& r) {
  const double kLogits[] = {
      -std::log(254.0), std::log(0.999 / 0.001), std::log(0.005 / 0.995), 20, 100, -20, -100, 16.6, 0};
  s.at(s.l.opacity) = chance(r, 0.8) ? kLogits[pick(r, std::size(kLogits))] : r.uniform(-12, 12);
}

void colours(Splat& s, Random& r) {
  constexpr double kColours[] = {0, -1, 1e3, 1e-30, -1e6, 1};
  for (int row = s.l.rgb; row < s.l.rgb + 3; ++row) s.at(row) = kColours[pick(r, std::size(kColours))];
}

void at_near_plane(Splat& s, const Scene& scene, Random& r) {
  const double kDepths[] = {0,
                            1e-8,
                            -1e-8,
                            scene.near_plane,
                            std::nextafter(scene.near_plane, 1.0f),
                            std::nextafter(scene.near_plane, 0.0f),
                            0.0101,
                            0.011,
                            0.02};
  const double z = chance(r, 0.7) ? kDepths[pick(r, std::size(kDepths))] : r.uniform(0.01, 0.05);
  const double slope_y = r.uniform(-1, 1), slope_x = r.uniform(-1, 1);
  place(s, scene, slope_x, slope_y, z);
  for (int i = 0; i < 3; ++i) s.at(s.l.scale + i) = inverse_softplus_of(log_uniform(r, 1e-4, 0.1));
  aim(s, scene, r, 0.3);
}

void beside_frustum(Splat& s, const Scene& scene, Random& r) {
  const double z = log_uniform(r, 0.02, 3), size = log_uniform(r, 1, 1e4), slope = size * random_sign(r);
  const bool across = chance(r, 0.5);
  place(s, scene, across ? slope : r.uniform(-1, 1), across ? r.uniform(-1, 1) : slope, z);
  for (int i = 0; i < 3; ++i) s.at(s.l.scale + i) = inverse_softplus_of(size * z * log_uniform(r, 0.01, 3));
  aim(s, scene, r, 0.3);
}

void around_camera(Splat& s, const Scene& scene, Random& r) {
  const double z = chance(r, 0.5) ? r.uniform(-0.1, 0.3) : 0.0;
  const double slope_y = r.uniform(-2, 2), slope_x = r.uniform(-2, 2);
  place(s, scene, slope_x, slope_y, z);
  for (int i = 0; i < 3; ++i) s.at(s.l.scale + i) = inverse_softplus_of(r.uniform(0.3, 3));
  aim(s, scene, r, 0.3);
}

// Moves the query mean of the splat relative to the query of the camera: to the same place, far away, or to a
// distance at which the query factor reaches its floor.
void at_query(Splat& s, const Scene& scene, Random& r) {
  const std::vector<double> q = query_at(s, scene);
  constexpr double kOffsets[] = {0, 1e-6, 1, 2.884, 3, 30, 1e4};
  for (int i = 0; i < s.l.query; ++i) {
    const double sign = random_sign(r);
    s.at(s.l.mean + i) = q[static_cast<std::size_t>(i)] + sign * kOffsets[pick(r, std::size(kOffsets))];
  }
  if (s.l.query >= 3 && chance(r, 0.2))
    for (int i = 0; i < 3; ++i) s.at(s.l.mean + i) = -q[static_cast<std::size_t>(i)];
}

void at_tile_edge(Splat& s, const Scene& scene, Random& r) {
  const Camera& c = scene.camera;
  const double y = 8.0 * static_cast<double>(pick(r, 3)), x = 16.0 * static_cast<double>(pick(r, 3));
  place(s, scene, (x - c.cx) / c.fx, (y - c.cy) / c.fy, 2);
}

// Replaces one to three parameters by NaN, infinities, or very small or large numbers.
void poison(Splat& s, Random& r) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const double kValues[] = {std::nan(""), kInfinity, -kInfinity, 1e-42, -0.0,
                            FLT_MAX,      -FLT_MAX,  FLT_MIN,    1e20,  -1e20};
  const int count = 1 + static_cast<int>(pick(r, 3));
  for (int i = 0; i < count; ++i) s.raw[pick(r, s.raw.size())] = kValues[pick(r, std::size(kValues))];
}

// Makes one random property of the splat extreme.
void stretch(Splat& s, const Scene& scene, Random& r) {
  switch (pick(r, 14)) {
    case 0:
      return extreme_betas(s, r);
    case 1:
      return extreme_scales(s, r);
    case 2:
      return needle(s, r);
    case 3:
      return large_rotation(s, r);
    case 4:
      return coupled_query(s, r);
    case 5:
      return query_scales(s, r);
    case 6:
      return opacities(s, r);
    case 7:
      return colours(s, r);
    case 8:
      return at_near_plane(s, scene, r);
    case 9:
      return beside_frustum(s, scene, r);
    case 10:
      return around_camera(s, scene, r);
    case 11:
      return at_query(s, scene, r);
    case 12:
      return at_tile_edge(s, scene, r);
    default:
      return;
  }
}

std::size_t random_count(Random& r) {
  if (chance(r, 0.01)) return 0;
  if (chance(r, 0.01)) return 200 + pick(r, 300);
  if (chance(r, 0.05)) return 16 + pick(r, 50);
  return 1 + pick(r, 8);
}

}  // namespace

Case random_case(std::uint64_t seed, std::uint64_t number) {
  Random r(seed * 0x9e3779b97f4a7c15ULL + number * 0xbf58476d1ce4e5b9ULL + 1);
  for (int i = 0; i < 4; ++i) r.bits();
  const Form form = random_form(r);
  Case c;
  c.name = fmt::format("random.{}.{}", seed, number);
  c.seed = seed ^ number << 20;
  c.camera = random_camera(r, form.dim);
  c.query_grad = form.variant == ModelVariant{} && form.dim == 6 && chance(r, 0.15);
  for (float& b : c.settings.background) b = chance(r, 0.5) ? static_cast<float>(r.uniform(0, 1)) : 0.0f;
  c.model = SplatModel(form.dim, random_count(r), form.variant);
  const ParameterLayout layout = c.model.layout();
  const Scene scene{c.camera, c.camera.centre(), c.settings.projection.near_plane};
  const double depth = chance(r, 0.8) ? r.uniform(1, 4) : log_uniform(r, 0.1, 1e4);
  const bool calm = chance(r, 0.1), poisoned = chance(r, 0.08);
  for (std::size_t i = 0; i < c.model.count; ++i) {
    Splat s(layout);
    ordinary(s, scene, r, depth * r.uniform(0.7, 1.4));
    for (int n = static_cast<int>(pick(r, 3)); !calm && n > 0; --n) stretch(s, scene, r);
    if (poisoned && chance(r, 0.5)) poison(s, r);
    for (int row = 0; row < layout.count; ++row) c.model.row(row)[i] = static_cast<float>(s.at(row));
  }
  if (c.model.count > 1 && chance(r, 0.1))  // two splats with equal depths
    for (int row = 0; row < layout.count; ++row)
      if (row < layout.rgb || row >= layout.opacity)
        c.model.row(row)[0] = c.model.row(row)[c.model.count - 1];
  return c;
}

}  // namespace ubs::stress
