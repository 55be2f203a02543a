// SPDX-License-Identifier: Apache-2.0
#include "tests/stress/case.hpp"

#include <cmath>
#include <limits>

#include "host/base/error.hpp"
#include "host/base/philox.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs::stress {
namespace {

double raw_scale(double scale) {
  return scale == 0 ? -std::numeric_limits<double>::infinity() : inverse_softplus_of(scale);
}

}  // namespace

std::vector<float> pixel_weights(const Case& c) {
  const std::uint64_t width = static_cast<std::uint64_t>(c.camera.width),
                      height = static_cast<std::uint64_t>(c.camera.height);
  const CounterRandom random(c.seed, 0x57656967u);
  std::vector<float> weights(3 * width * height);
  for (std::uint64_t y = 0; y < height; ++y)
    for (std::uint64_t x = 0; x < width; ++x) {
      const std::uint64_t item = y << 32 | x;
      for (std::uint32_t channel = 0; channel < 3; ++channel)
        weights[channel * width * height + y * width + x] =
            static_cast<float>(random.uniform(item, channel, -1, 1));
    }
  return weights;
}

Case row_case(const std::string& name, int dim, std::size_t splats, const ModelVariant& variant) {
  Case c;
  c.name = fmt::format("{}.n{}", name, dim);
  c.seed = 7;
  c.model = SplatModel(dim, splats, variant);
  c.camera.fx = c.camera.fy = 32;
  c.camera.width = 32, c.camera.height = 24;
  c.camera.cx = 16, c.camera.cy = 12;
  c.camera.time = 0.5;
  if (dim == 5) c.camera.extra = {0.25};
  c.settings.background = {0.1f, 0.2f, 0.3f};
  for (std::size_t i = 0; i < splats; ++i) put_splat(c, i, {});
  return c;
}

void put_splat(Case& c, std::size_t i, const SplatPlan& plan) {
  const ParameterLayout l = c.model.layout();
  const auto put = [&](int row, double value) { c.model.row(row)[i] = static_cast<float>(value); };
  Random random(i + 17);
  const std::array<double, 3> centre = c.camera.centre();
  std::array<double, 3> w{};
  for (std::size_t k = 0; k < 3; ++k) {
    put(l.xyz + static_cast<int>(k), plan.position[k]);
    w[k] = static_cast<float>(plan.position[k]) - centre[k];
  }
  for (int row = l.rgb; row < l.opacity; ++row) put(row, random.uniform(0.1, 0.9));
  put(l.opacity, plan.opacity_raw);
  if (l.variant.has_spatial_beta()) put(l.beta, plan.beta_raw);
  for (int row = l.query_beta; row < l.mean; ++row) put(row, plan.query_beta_raw);
  const double rho = std::max(1e-12, std::hypot(w[0], w[1], w[2]));
  for (int q = 0; q < l.query; ++q) {
    const bool direction = l.query >= 3 && q < 3;
    const double value = direction                     ? w[static_cast<std::size_t>(q)] / rho
                         : q == (l.query >= 3 ? 3 : 0) ? c.camera.time
                                                       : c.camera.extra[0];
    put(l.mean + q, value + plan.query_offset * random.uniform(0.5, 1));
  }
  for (int k = 0; k < l.dim; ++k)
    put(l.scale + k, raw_scale(k < 3 ? plan.scale[static_cast<std::size_t>(k)] : plan.query_scale));
  const int rotations = l.variant.rot_mode == RotMode::quaternion ? 4 : 3;
  for (int row = l.l_triangle; row < l.count; ++row)
    put(row, (row < l.l_triangle + rotations ? plan.omega : plan.coupling) * random.uniform(-1, 1));
}

Case ordinary_case(const std::string& name, int dim, std::size_t count, std::uint64_t seed) {
  Case c = row_case(name, dim, count);
  Random random(seed);
  for (std::size_t i = 0; i < count; ++i) {
    SplatPlan plan;
    const double z = random.uniform(1.5, 3);
    plan.position = {z * random.uniform(-0.5, 0.5), z * random.uniform(-0.4, 0.4), z};
    for (double& s : plan.scale) s = random.uniform(0.1, 0.6);
    plan.opacity_raw = random.uniform(-2, 2);
    plan.beta_raw = random.uniform(-1, 1), plan.query_beta_raw = random.uniform(-1, 1);
    put_splat(c, i, plan);
  }
  return c;
}

}  // namespace ubs::stress
