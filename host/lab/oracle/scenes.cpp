// SPDX-License-Identifier: Apache-2.0
// This file generates the test scenes. It chooses random values of the activated parameters and stores the
// raw parameters.
#include "host/lab/oracle/scenes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ubs::oracle {
namespace {

using Vector = std::array<double, 3>;
constexpr std::uint64_t kModelStream = 0x6d6f64656cULL, kTargetStream = 0x746172676574ULL;

double as_float(double x) { return static_cast<double>(static_cast<float>(x)); }

Vector normalized(const Vector& v) {
  const double length = std::hypot(v[0], v[1], v[2]);
  return {v[0] / length, v[1] / length, v[2] / length};
}

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vector centre_of(const Camera& camera) {
  Vector result{};
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) result[i] -= camera.rotation[3 * k + i] * camera.translation[k];
  return result;
}

// Returns the world position of the point at camera-space (x/z, y/z) and depth z.
Vector unproject(const Camera& camera, double slope_x, double slope_y, double z) {
  const Vector p{slope_x * z - camera.translation[0], slope_y * z - camera.translation[1],
                 z - camera.translation[2]};
  Vector result{};
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) result[i] += camera.rotation[3 * k + i] * p[k];
  return result;
}

// Splat contains the values of one splat, mostly after activation. All generators of scenes use it. store()
// converts the values to raw parameters and writes them to a model.
struct Splat {
  explicit Splat(int dim)
      : beta(dim - 2, 0.0), mean(dim - 3, 0.0), scale(dim, 1.0), triangle(dim * (dim - 1) / 2) {}
  Vector position{};
  Vector rgb{0.5, 0.5, 0.5};
  double opacity_logit = 0;
  std::vector<double> beta, mean, scale, triangle;  // `beta` is raw, `scale` is activated
};

double inverse_softplus(double y) { return y + std::log(-std::expm1(-y)); }

// Appends the raw values of the colour. `random` supplies the values that exist only in some variants.
void put_colour(const Splat& splat, const ModelVariant& variant, Random& random, std::vector<double>& out) {
  if (variant.colour == ColourMode::rgb) {
    out.insert(out.end(), splat.rgb.begin(), splat.rgb.end());
    return;
  }
  for (double x : splat.rgb) out.push_back((x - 0.5) / 0.28209479177387814);
  for (int k = 0; k < 3 * (variant.harmonics() - 1); ++k) out.push_back(0.15 * random.normal());
  const int lobes = variant.lobes();
  for (int k = 0; k < 3 * lobes; ++k) out.push_back(0.15 * random.normal());  // colours
  for (int k = 0; k < 2 * lobes; ++k) out.push_back(random.uniform(-3, 3));   // angles
  for (int k = 0; k < lobes; ++k) out.push_back(random.uniform(-2, 2));       // raw betas
}

void put_rotation(const Splat& splat, const ModelVariant& variant, Random& random, std::vector<double>& out) {
  if (variant.rot_mode == RotMode::quaternion) {
    for (int k = 0; k < 4; ++k) out.push_back(random.uniform(-1, 1));
    return;
  }
  for (std::size_t k = 0; k < splat.triangle.size(); ++k) {
    // With `cholesky`, the first three values are entries of a factor in world units instead of angles. They
    // are reduced, because the scales are only 0.12 to 0.45.
    const bool spatial_entry = k < 3 && variant.cov_param == CovParam::cholesky;
    out.push_back(splat.triangle[k] * (spatial_entry ? 0.3 : 1));
  }
}

void store(const Splat& splat, std::size_t index, SplatModel& model) {
  const ModelVariant& variant = model.variant;
  Random random(0x766172ULL + 7919 * index);
  const bool betas = variant.beta_cond == BetaCond::on || variant.beta_opacity == BetaOpacity::tanh;
  std::vector<double> values(splat.position.begin(), splat.position.end());
  put_colour(splat, variant, random, values);
  values.push_back(splat.opacity_logit);
  if (variant.has_spatial_beta()) values.push_back(splat.beta[0]);
  if (betas) values.insert(values.end(), splat.beta.begin() + 1, splat.beta.end());
  values.insert(values.end(), splat.mean.begin(), splat.mean.end());
  // With a third of the scale as standard deviation, a Gaussian has about the same footprint as the Beta
  // kernel.
  const bool narrower = !row_of(variant.kernel).scale_is_support;
  for (std::size_t i = 0; i < splat.scale.size(); ++i)
    values.push_back(inverse_softplus(narrower && i < 3 ? splat.scale[i] / 3 : splat.scale[i]));
  put_rotation(splat, variant, random, values);
  for (std::size_t row = 0; row < values.size(); ++row)
    model.values[row * model.count + index] = static_cast<float>(values[row]);
}

SplatModel make_model(const SceneOptions& options, std::size_t count) {
  const int dim = options.dim;
  const ModelVariant& v = options.variant;
  SplatModel model;
  model.dim = dim;
  model.variant = v;
  model.count = count;
  int rows = dim * (dim + 1) / 2 + 2 * dim + 2;
  if (v.colour != ColourMode::rgb) rows += 3 * v.harmonics() - 3 + 6 * v.lobes();
  if (!v.has_spatial_beta()) rows -= 1;
  if (v.beta_cond == BetaCond::off && v.beta_opacity != BetaOpacity::tanh) rows -= dim - 3;
  if (v.rot_mode == RotMode::quaternion) rows += 4 - dim * (dim - 1) / 2;
  model.values.assign(static_cast<std::size_t>(rows) * count, 0.0f);
  return model;
}

// Returns the query of `camera` for a splat at `position`, in the query order of the model.
std::vector<double> query_at(const Vector& position, const Camera& camera, int dim) {
  std::vector<double> q;
  if (dim >= 6) {
    const Vector c = centre_of(camera);
    const Vector d = normalized({position[0] - c[0], position[1] - c[1], position[2] - c[2]});
    q.assign(d.begin(), d.end());
  }
  if (static_cast<int>(q.size()) < dim - 3) q.push_back(camera.time);
  for (int i = 0; static_cast<int>(q.size()) < dim - 3; ++i) q.push_back(camera.extra[i]);
  return q;
}

// Returns an ordinary splat at `position`. It depends moderately on the query, its rotation vector has a
// length of at most 0.7, and it is well visible from `camera`.
Splat ordinary_splat(Random& random, int dim, const Vector& position, const Camera& camera) {
  Splat splat(dim);
  splat.position = position;
  for (double& x : splat.rgb) x = random.uniform(0, 1);
  const double opacity = random.uniform(0.05, 0.95);
  splat.opacity_logit = std::log(opacity / (1 - opacity));
  for (double& x : splat.beta) x = random.uniform(-1.5, 1.0);
  splat.mean = query_at(position, camera, dim);
  for (double& x : splat.mean) x += random.uniform(-0.35, 0.35);
  for (int i = 0; i < dim; ++i)
    splat.scale[i] = i < 3 ? random.uniform(0.12, 0.45) : random.uniform(0.5, 1.5);
  for (std::size_t i = 0; i < splat.triangle.size(); ++i)
    splat.triangle[i] = i < 3 ? random.uniform(-0.4, 0.4) : 0.3 * random.normal();
  return splat;
}

Vector random_position(Random& random) {
  return {random.uniform(-0.9, 0.9), random.uniform(-0.9, 0.9), random.uniform(-0.9, 0.9)};
}

void make_opaque(Splat& splat, const Camera& camera, int dim) {
  splat.opacity_logit = 10;  // an opacity of 0.99995
  splat.mean = query_at(splat.position, camera, dim);
  for (double& b : splat.beta) b = -2.5;
}

// Moves the query mean so far away that every opacity factor is at its lower bound eps^beta. eps is 2^-23,
// and beta is 4 exp(raw). With the raw betas from -5.5 to -4.5, this bound is 0.5 to 0.8, so that the splat
// remains visible.
void make_floored(Splat& splat, Random& random) {
  for (double& m : splat.mean) m += 6;
  for (std::size_t i = 1; i < splat.beta.size(); ++i) splat.beta[i] = random.uniform(-5.5, -4.5);
  for (std::size_t i = 3; i < splat.triangle.size(); ++i) splat.triangle[i] *= 0.3;
}

// Places the mean beyond 1.3 times the half field of view, with a support that is large enough to reach into
// the image.
void make_off_screen(Splat& splat, Random& random, const Camera& camera, int dim) {
  const double limit = (camera.width - camera.cx) / camera.fx + 0.3 * camera.width / (2 * camera.fx);
  splat.position =
      unproject(camera, limit * random.uniform(1.05, 1.3), random.uniform(-0.3, 0.3), random.uniform(2, 3));
  splat.mean = query_at(splat.position, camera, dim);
  for (double& m : splat.mean) m += random.uniform(-0.2, 0.2);
  for (int i = 0; i < 3; ++i) splat.scale[i] = random.uniform(1.2, 1.8);
}

Scene start_scene(const SceneOptions& options, std::size_t count) {
  Scene scene;
  scene.model = make_model(options, count);
  scene.camera = ring_camera(options, 0);
  scene.target = smooth_target(options.width, options.height, options.seed);
  scene.background = {as_float(0.1), as_float(0.3), as_float(0.2)};
  return scene;
}

}  // namespace

Camera ring_camera(const SceneOptions& options, int index) {
  const double angle = 0.3 + 2 * std::numbers::pi * index / kRingCameras;
  const Vector centre{3 * std::cos(angle), 0.5 * std::sin(2 * angle), 3 * std::sin(angle)};
  const Vector forward = normalized({-centre[0], -centre[1], -centre[2]});
  const Vector right = normalized(cross({0, 1, 0}, forward));
  const Vector down = cross(forward, right);
  Camera camera;
  const std::array<Vector, 3> axes{right, down, forward};
  for (int i = 0; i < 3; ++i) {
    double t = 0;
    for (int k = 0; k < 3; ++k) {
      camera.rotation[3 * i + k] = as_float(axes[i][k]);
      t -= axes[i][k] * centre[k];
    }
    camera.translation[i] = as_float(t);
  }
  camera.width = options.width, camera.height = options.height;
  camera.fx = as_float(0.9 * options.width), camera.fy = as_float(0.95 * options.width);
  camera.cx = as_float(0.47 * options.width), camera.cy = as_float(0.54 * options.height);
  camera.time = as_float(0.4 + 0.4 * std::sin(1.7 * index));
  const int query = options.dim - 3;
  const int extra = query == 2 ? 1 : std::max(0, query - 4);
  for (int i = 0; i < extra; ++i) camera.extra.push_back(as_float(0.5 + 0.3 * std::cos(1.1 * index + i)));
  return camera;
}

std::vector<double> smooth_target(int width, int height, std::uint64_t seed) {
  Random random(seed ^ kTargetStream);
  std::vector<double> target;
  target.reserve(static_cast<std::size_t>(3) * width * height);
  for (int c = 0; c < 3; ++c) {
    const double base = random.uniform(0.35, 0.65), phase_x = random.uniform(0, 6),
                 phase_y = random.uniform(0, 6);
    const double wave_x = random.uniform(1, 4), wave_y = random.uniform(1, 4);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        target.push_back(as_float(base + 0.2 * std::sin(phase_x + wave_x * (x + 0.5) / width * 2) +
                                  0.14 * std::cos(phase_y + wave_y * (y + 0.5) / height * 2)));
  }
  return target;
}

Scene regular_scene(const SceneOptions& options) {
  Scene scene = start_scene(options, options.count);
  Random random(options.seed ^ kModelStream);
  for (std::size_t i = 0; i < options.count; ++i) {
    // Five of six splats are made for camera 0. The others are made for a random camera of the ring, and are
    // less opaque when seen from camera 0; some opacity factors are at their lower bound.
    const int owner = random.uniform(0, 6) < 5 ? 0 : static_cast<int>(random.bits() % kRingCameras);
    const Camera camera = ring_camera(options, owner);
    Splat splat = ordinary_splat(random, options.dim, random_position(random), camera);
    if (i % 32 == 5) make_opaque(splat, scene.camera, options.dim);
    if (i % 32 == 13) make_floored(splat, random);
    if (i % 32 == 21) make_off_screen(splat, random, scene.camera, options.dim);
    if (i % 32 == 29) splat.position = unproject(scene.camera, 0.1, -0.2, random.uniform(-3, -0.5));
    store(splat, i, scene.model);
  }
  return scene;
}

Scene huge_splat_scene(const SceneOptions& options) {
  Scene scene = start_scene(options, 1);
  Random random(options.seed ^ kModelStream);
  Splat splat = ordinary_splat(random, options.dim, {0, 0, 0}, scene.camera);
  splat.opacity_logit = 1.5;
  for (int i = 0; i < 3; ++i) splat.scale[i] = 20;
  store(splat, 0, scene.model);
  return scene;
}

Scene crowded_tile_scene(const SceneOptions& options) {
  Scene scene = start_scene(options, options.count);
  Random random(options.seed ^ kModelStream);
  const Camera& camera = scene.camera;
  for (std::size_t i = 0; i < options.count; ++i) {
    const double x = (random.uniform(16, 32) - camera.cx) / camera.fx;
    const double y = (random.uniform(16, 32) - camera.cy) / camera.fy;
    Splat splat = ordinary_splat(random, options.dim, unproject(camera, x, y, random.uniform(2, 4)), camera);
    splat.opacity_logit = random.uniform(-5, -2);
    for (int k = 0; k < 3; ++k) splat.scale[k] = random.uniform(0.05, 0.15);
    store(splat, i, scene.model);
  }
  return scene;
}

Scene behind_camera_scene(const SceneOptions& options) {
  Scene scene = start_scene(options, options.count);
  Random random(options.seed ^ kModelStream);
  for (std::size_t i = 0; i < options.count; ++i) {
    // The splats are so far behind the camera that conditioning cannot move a mean in front of it.
    const Vector position = unproject(scene.camera, random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5),
                                      random.uniform(-20, -10));
    store(ordinary_splat(random, options.dim, position, scene.camera), i, scene.model);
  }
  return scene;
}

Scene empty_scene(const SceneOptions& options) { return start_scene(options, 0); }

Scene single_splat_scene(const SceneOptions& options) {
  Scene scene = start_scene(options, 1);
  Random random(options.seed ^ kModelStream);
  store(ordinary_splat(random, options.dim, {0, 0, 0}, scene.camera), 0, scene.model);
  return scene;
}

Scene identical_depth_scene(const SceneOptions& options) {
  Scene scene = start_scene(options, options.count);
  Random random(options.seed ^ kModelStream);
  scene.camera.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  scene.camera.translation = {0, 0, 3};
  for (std::size_t i = 0; i < options.count; ++i) {
    const Vector position{random.uniform(-0.9, 0.9), random.uniform(-0.9, 0.9), 0};
    Splat splat = ordinary_splat(random, options.dim, position, scene.camera);
    // Set the entries that couple the query with the position (the block Lqx) to 0. Then the conditional mean
    // equals the mean, so the depths are exactly equal in float and in double.
    for (int q = 3; q < options.dim; ++q)
      for (int k = 0; k < 3; ++k) splat.triangle[q * (q - 1) / 2 + k] = 0;
    store(splat, i, scene.model);
  }
  return scene;
}

Scene opaque_stack_scene(const SceneOptions& options) {
  Scene scene = start_scene(options, options.count);
  Random random(options.seed ^ kModelStream);
  for (std::size_t i = 0; i < options.count; ++i) {
    const double z =
        2 + 2 * static_cast<double>(i) / static_cast<double>(std::max<std::size_t>(options.count, 1));
    const Vector position = unproject(scene.camera, random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), z);
    Splat splat = ordinary_splat(random, options.dim, position, scene.camera);
    make_opaque(splat, scene.camera, options.dim);
    for (int k = 0; k < 3; ++k) splat.scale[k] = random.uniform(0.4, 0.6);
    splat.opacity_logit = 2.2;  // an opacity of 0.9; four layers reduce the transmittance to about 1e-4
    for (std::size_t k = 3; k < splat.triangle.size(); ++k) splat.triangle[k] *= 0.2;
    store(splat, i, scene.model);
  }
  return scene;
}

}  // namespace ubs::oracle
