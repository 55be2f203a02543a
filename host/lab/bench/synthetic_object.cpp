// SPDX-License-Identifier: Apache-2.0
// This file implements synthetic_object() of bench_scene.hpp. It chooses the position, the size and the depth
// of each splat at random in the image of the first camera, and computes the splat in space from these.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/base/philox.hpp"
#include "host/dataset/synthetic.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs::bench {
namespace {

constexpr double kThickness = 1.0;  // half of the depth of the object
// kCover determines the sizes of the splats (see Object). It is chosen so that about 50 splats are blended
// per pixel of the object. kObjectShare is the approximate share of the image that the object covers.
constexpr double kCover = 70, kObjectShare = 0.5;
constexpr double kBlur = 0.3;            // eps2d; subtracted here, because the projection adds it [px^2]
constexpr double kSmallestRadius = 0.9;  // in the image [px]

enum Lane : std::uint32_t {
  kSize = 0,
  kAnisotropy,
  kAngle,
  kFaint,
  kOpacity,
  kBeta,
  kRed,
  kGreen,
  kBlue,
  kDepth
};
enum Stream : std::uint32_t { kShape, kPlace, kQuery };

double logit(double p) { return std::log(p / (1 - p)); }

// Returns a random point of the silhouette in [-1, 1]^2, which consists of two crossed ellipses.
std::array<double, 2> silhouette(const CounterRandom& random, std::size_t i) {
  for (std::uint32_t lane = 0;; lane += 2) {
    const double x = random.uniform(i, lane, -1, 1), y = random.uniform(i, lane + 1, -1, 1);
    const auto inside = [&](double centre, double a, double b) {
      return (x - centre) * (x - centre) / (a * a) + y * y / (b * b) < 1;
    };
    if (inside(0, 0.8, 0.55) || inside(0.2, 0.35, 0.85)) return {x, y};
  }
}

struct Splat {
  double x, y, z;       // camera frame
  double s0, s1, tilt;  // support radii in space along axes that are rotated by atan(tilt)
  double opacity, beta;
};

class Object {
 public:
  Object(std::size_t splats, int width, int height)
      : width_(width), height_(height), focal_(width / (2 * std::tan(kSyntheticAngleX / 2))) {
    const double area = kCover * kObjectShare * width * height / static_cast<double>(splats);
    // kCover was chosen together with the divisor 1.22.
    base_ = std::sqrt(area / std::numbers::pi) / 1.22;
  }

  Splat draw(std::size_t i) const {
    const auto [u, v] = silhouette(CounterRandom(1234, kPlace), i);
    const CounterRandom random(1234, kShape);
    const auto n = [&](Lane lane) { return random.normal(i, lane); };
    const auto uniform = [&](Lane lane) { return random.uniform(i, lane); };
    Splat s{};
    s.z = kSyntheticDistance + kThickness * (2 * uniform(kDepth) - 1);
    const double unit = s.z / focal_;  // size of a pixel in space at this depth
    s.x = u * width_ / 2 * unit;
    s.y = v * height_ / 2 * unit;
    const double size = base_ * std::exp(0.55 * n(kSize) - 0.30), ratio = std::exp(0.45 * n(kAnisotropy));
    const auto radius = [&](double pixels) {
      const double wanted = std::max(pixels, kSmallestRadius);
      return std::sqrt(std::max(wanted * wanted - kBlur, 0.1)) * unit;
    };
    // Either axis can be the longer one, so angles between -45 and 45 degrees cover all orientations.
    s.tilt = std::tan((uniform(kAngle) - 0.5) * std::numbers::pi / 2);
    s.s0 = radius(size * std::sqrt(ratio));
    s.s1 = radius(size / std::sqrt(ratio));
    s.opacity = uniform(kFaint) < 0.45 ? 0.03 + 0.25 * uniform(kOpacity) : 0.3 + 0.68 * uniform(kOpacity);
    s.beta = std::min(0.6 * n(kBeta), std::log(4.0));  // exponent 4 exp(beta), at most 16
    return s;
  }

  double focal() const { return focal_; }

 private:
  int width_, height_;
  double focal_, base_;
};

// Adds a slight dependence on the query. One standard deviation is 0.3 of the query scale of the splat, and
// the exponents of the query kernels are small, so that opacities and shapes remain close to the chosen ones.
void set_query(SplatModel& model, std::size_t i, const Splat& s) {
  const ParameterLayout layout = model.layout();
  const CounterRandom random(1234, kQuery);
  const double length = std::sqrt(s.x * s.x + s.y * s.y + s.z * s.z);
  const double direction[3] = {s.x / length, s.y / length, s.z / length};
  for (int q = 0; q < layout.query; ++q) {
    const auto lane = static_cast<std::uint32_t>(q);
    const bool is_direction = layout.query >= 3 && q < 3;
    const double at = is_direction ? direction[q] : 0.0;  // the view direction, or time 0
    model.row(layout.mean + q)[i] = static_cast<float>(at + 0.3 * random.normal(i, lane));
    model.row(layout.scale + 3 + q)[i] = static_cast<float>(inverse_softplus_of(1.0));
    model.row(layout.beta + 1 + q)[i] = -2.5f;
    for (int j = 0; j < 3 + q; ++j) {
      const int row = q + 3;
      model.row(layout.l_triangle + row * (row - 1) / 2 + j)[i] =
          static_cast<float>(0.1 * random.normal(i, 16 + 16 * lane + static_cast<std::uint32_t>(j)));
    }
  }
}

void set_splat(SplatModel& model, std::size_t i, const Splat& s) {
  const ParameterLayout layout = model.layout();
  const CounterRandom random(1234, kShape);
  const auto set = [&](int row, double value) { model.row(row)[i] = static_cast<float>(value); };
  set(layout.xyz, s.x);
  set(layout.xyz + 1, s.y);
  set(layout.xyz + 2, s.z - kSyntheticDistance);
  for (int c = 0; c < 3; ++c) set(layout.rgb + c, random.uniform(i, static_cast<std::uint32_t>(kRed + c)));
  set(layout.opacity, logit(s.opacity));
  set(layout.beta, s.beta);
  // The first two columns of I + A are orthogonal to each other and have the length sqrt(1 + tilt^2).
  const double stretch = std::sqrt(1 + s.tilt * s.tilt);
  set(layout.l_triangle, s.tilt);
  set(layout.scale, inverse_softplus_of(s.s0 / stretch));
  set(layout.scale + 1, inverse_softplus_of(s.s1 / stretch));
  set(layout.scale + 2, inverse_softplus_of(std::sqrt(s.s0 * s.s1)));
  set_query(model, i, s);
}

// Returns a camera that is rotated about the vertical axis of the object by a multiple of half a degree. This
// gives different rays with the same statistics.
Camera camera_of(std::size_t view, int width, int height, double focal) {
  const double angle = 0.5 * std::numbers::pi / 180 * static_cast<double>(view % 8);
  Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = focal;
  camera.cx = width / 2.0;
  camera.cy = height / 2.0;
  camera.rotation = {std::cos(angle), 0, std::sin(angle), 0, 1, 0, -std::sin(angle), 0, std::cos(angle)};
  camera.translation = {0, 0, kSyntheticDistance};
  camera.extra.assign(8, 0.0);
  return camera;
}

}  // namespace

BenchScene synthetic_object(int dim, std::size_t splats, int width, int height, std::size_t views) {
  const Object object(splats, width, height);
  BenchScene scene{SplatModel(dim, splats), {"train", {}}, {1, 1, 1}};
  constexpr std::size_t kBlock = 4096;
  parallel_for((splats + kBlock - 1) / kBlock, [&](std::size_t block) {
    const std::size_t end = std::min(splats, (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) set_splat(scene.model, i, object.draw(i));
  });
  for (std::size_t v = 0; v < views; ++v)
    scene.views.views.push_back({fmt::format("view_{}", v), camera_of(v, width, height, object.focal()),
                                 made_up_image(width, height)});
  return scene;
}

}  // namespace ubs::bench
