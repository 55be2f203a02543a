// SPDX-License-Identifier: Apache-2.0
// This file contains the scene `cloud`. It integrates colour C and transmittance T along a ray, dC = T sigma
// c ds and dT = -T sigma ds. The density sigma and the data for the source colour c are computed once and
// stored in a grid. The source colour is the sum of three terms: sunlight that has passed through the cloud,
// sky light, and a glow of the core. Sunlight is scattered mainly forwards, so that the appearance depends on
// the view direction.
#include <algorithm>
#include <array>
#include <vector>

#include "host/base/parallel.hpp"
#include "host/base/philox.hpp"
#include "host/scene/synthetic_scene.hpp"

namespace ubs::synthetic {

namespace {

constexpr int kGrid = 96;
constexpr double kHalf = 1.15;  // half size of the volume
constexpr double kCell = 2 * kHalf / (kGrid - 1);
constexpr double kStep = 1.5 * kCell;  // with a third of this step, no pixel changes by more than 2/255
constexpr double kOuter = 1.12;        // half axis of the ellipsoid; the density outside of it is 0
constexpr double kExtinction = 9.0;    // per unit length at density 1
constexpr int kLattice = 16;           // period of the noise; a power of two
const Vec3 kSun = normalize(Vec3(0.6, -0.5, 0.75));

// Noise computes smooth noise in [0,1]. It interpolates random values on a periodic lattice with a quintic
// polynomial. The second derivative of the result is continuous, so that the planes of the lattice are not
// visible.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : values_(kLattice * kLattice * kLattice) {
    const CounterRandom random(seed, 100);
    for (std::size_t i = 0; i < values_.size(); ++i) values_[i] = random.uniform(i, 0);
  }

  double octaves(const Vec3& p) const {
    double sum = 0, weight = 0.5;
    for (int octave = 0; octave < 4; ++octave, weight *= 0.5)
      sum += weight * at(p * std::exp2(octave) + Vec3::all(5.3 * octave));
    return sum / 0.9375;
  }

 private:
  double at(const Vec3& p) const {
    std::array<int, 3> cell{};
    Vec3 f;
    for (int k = 0; k < 3; ++k) {
      const double low = std::floor(p[k]), x = p[k] - low;
      cell[static_cast<std::size_t>(k)] = static_cast<int>(low);
      f[k] = x * x * x * (x * (6 * x - 15) + 10);
    }
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const int dx = corner & 1, dy = corner >> 1 & 1, dz = corner >> 2;
      const double weight = (dx ? f[0] : 1 - f[0]) * (dy ? f[1] : 1 - f[1]) * (dz ? f[2] : 1 - f[2]);
      sum += weight * value(cell[0] + dx, cell[1] + dy, cell[2] + dz);
    }
    return sum;
  }

  double value(int x, int y, int z) const {
    constexpr int mask = kLattice - 1;
    return values_[static_cast<std::size_t>(((z & mask) * kLattice + (y & mask)) * kLattice + (x & mask))];
  }

  std::vector<double> values_;
};

struct Voxel {
  float density = 0, sun = 0, glow = 0;  // sun: transmittance towards the sun
};

class Cloud : public Scene {
 public:
  explicit Cloud(std::uint64_t seed) : voxels_(static_cast<std::size_t>(kGrid) * kGrid * kGrid) {
    const Noise noise(seed);
    parallel_for(kGrid, [&](std::size_t z) { fill_layer(noise, static_cast<int>(z)); });
    parallel_for(kGrid, [&](std::size_t z) { light_layer(static_cast<int>(z)); });
  }

  Sample trace(const Ray& ray, double, double, double) const override {
    double near = 0, far = 0;
    if (!clip(ray, near, far)) return {};
    const double cosine = ray.direction.dot(kSun);
    const double g = 0.35;  // for the Henyey-Greenstein phase function, scaled to 1 for an isotropic medium
    const double phase = (1 - g * g) / std::pow(1 + g * g - 2 * g * cosine, 1.5);
    Vec3 colour(0, 0, 0);
    double transmittance = 1;
    for (double s = near + kStep / 2; s < far && transmittance > 1e-3; s += kStep) {
      const Vec3 p = ray.origin + ray.direction * s;
      const Voxel v = sample(p);
      if (v.density < 1e-4f) continue;
      const double alpha = 1 - std::exp(-kExtinction * v.density * kStep);
      const Vec3 sky = mix({0.20, 0.22, 0.34}, {0.42, 0.50, 0.66}, 0.5 + 0.5 * p[2] / kHalf);
      const Vec3 source =
          sky + Vec3(0.80, 0.68, 0.50) * (v.sun * (0.45 + 0.55 * phase)) + Vec3(0.95, 0.30, 0.10) * v.glow;
      colour += clamp01(source) * (alpha * transmittance);
      transmittance *= 1 - alpha;
    }
    return {clamp01(colour), 1 - transmittance};
  }

 private:
  static Vec3 position(int x, int y, int z) {
    return {x * kCell - kHalf, y * kCell - kHalf, z * kCell - kHalf};
  }
  static std::size_t index(int x, int y, int z) {
    return static_cast<std::size_t>((z * kGrid + y) * kGrid + x);
  }

  // Computes the density and the glow of one layer of the grid from noise. Both fade out towards the surface
  // of an ellipsoid, so that they are 0 at the faces of the grid.
  void fill_layer(const Noise& noise, int z) {
    for (int y = 0; y < kGrid; ++y)
      for (int x = 0; x < kGrid; ++x) {
        const Vec3 p = position(x, y, z);
        const double radius = std::sqrt(p[0] * p[0] + p[1] * p[1] + 2.0 * p[2] * p[2]) / kOuter;
        const double body = noise.octaves(p * 2.6 + Vec3::all(3.7)) * 1.25 + 0.22 - 1.06 * radius * radius;
        Voxel& v = voxels_[index(x, y, z)];
        v.density = static_cast<float>(smoothstep(0.32, 0.85, body) * smoothstep(1.0, 0.8, radius));
        v.glow = static_cast<float>(0.9 * smoothstep(0.50, 0.72, noise.octaves(p * 1.9 + Vec3::all(11.1))) *
                                    smoothstep(0.74, 0.17, radius));
      }
  }

  void light_layer(int z) {
    for (int y = 0; y < kGrid; ++y)
      for (int x = 0; x < kGrid; ++x) {
        Voxel& voxel = voxels_[index(x, y, z)];
        if (voxel.density == 0) continue;  // `sun` has no effect where the density is 0: see sample()
        const Vec3 p = position(x, y, z);
        double depth = 0;
        for (double s = 2 * kCell; s < 1.4; s += 2 * kCell) depth += density(p + kSun * s) * 2 * kCell;
        voxel.sun = static_cast<float>(std::exp(-0.6 * kExtinction * depth));
      }
  }

  // Computes where a ray enters and leaves the ellipsoid x^2 + y^2 + 2 z^2 = kOuter^2, which contains all
  // density.
  static bool clip(const Ray& ray, double& near, double& far) {
    const auto product = [](const Vec3& a, const Vec3& b) {
      return a[0] * b[0] + a[1] * b[1] + 2 * a[2] * b[2];
    };
    const double a = product(ray.direction, ray.direction), b = product(ray.origin, ray.direction) / a;
    const double discriminant = b * b - (product(ray.origin, ray.origin) - kOuter * kOuter) / a;
    if (discriminant <= 0) return false;
    near = std::max(0.0, -b - std::sqrt(discriminant));
    far = -b + std::sqrt(discriminant);
    return near < far;
  }

  // Calls `visit` for each of the eight voxels around p, with the index of the voxel and its trilinear
  // weight.
  template <typename Visit>
  static void visit_corners(const Vec3& p, const Visit& visit) {
    std::array<int, 3> cell{};
    Vec3 f;
    for (int k = 0; k < 3; ++k) {
      const double x = std::clamp((p[k] + kHalf) / kCell, 0.0, kGrid - 1.001);
      cell[static_cast<std::size_t>(k)] = static_cast<int>(x);
      f[k] = x - std::floor(x);
    }
    for (int corner = 0; corner < 8; ++corner) {
      const int dx = corner & 1, dy = corner >> 1 & 1, dz = corner >> 2;
      visit(index(cell[0] + dx, cell[1] + dy, cell[2] + dz),
            (dx ? f[0] : 1 - f[0]) * (dy ? f[1] : 1 - f[1]) * (dz ? f[2] : 1 - f[2]));
    }
  }

  double density(const Vec3& p) const {
    double sum = 0;
    visit_corners(p, [&](std::size_t i, double w) { sum += w * voxels_[i].density; });
    return sum;
  }

  // Sun and glow are averaged with the density as weight, so that empty voxels do not darken the edge of the
  // cloud.
  Voxel sample(const Vec3& p) const {
    double density = 0, sun = 0, glow = 0;
    visit_corners(p, [&](std::size_t i, double w) {
      const Voxel& v = voxels_[i];
      density += w * v.density;
      sun += w * v.density * v.sun;
      glow += w * v.density * v.glow;
    });
    if (density <= 0) return {};
    return {static_cast<float>(density), static_cast<float>(sun / density),
            static_cast<float>(glow / density)};
  }

  std::vector<Voxel> voxels_;
};

}  // namespace

std::unique_ptr<Scene> make_cloud(std::uint64_t seed) { return std::make_unique<Cloud>(seed); }

}  // namespace ubs::synthetic
