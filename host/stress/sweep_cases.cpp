// SPDX-License-Identifier: Apache-2.0
#include "host/stress/sweep_cases.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "host/scene/splat_model.hpp"
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"

namespace ubs::stress {

double uniform(Generator& g, double low, double high) {
  return low + (high - low) * static_cast<double>(g() >> 11) * 0x1p-53;
}

namespace {

double inverse_softplus(double y) { return y > 20 ? y : std::log(std::expm1(y)); }

Camera sweep_camera(Generator* g) {
  Camera camera;
  camera.width = 1024, camera.height = 768;
  camera.fx = 700, camera.fy = 690, camera.cx = 512, camera.cy = 384;
  camera.time = 0.25;
  if (!g) return camera;
  double q[4], norm = 0;
  for (double& v : q) v = uniform(*g, -1, 1), norm += v * v;
  for (double& v : q) v /= std::sqrt(norm);
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                       2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                       2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  for (int i = 0; i < 9; ++i) camera.rotation[i] = static_cast<float>(r[i]);
  return camera;
}

// One splat being made, in double; rows as in the file.
struct Draft {
  Draft(int dim, Generator& generator, const ModelVariant& variant = {})
      : layout(dim, variant), raw(layout.count), g(generator) {}

  double& at(int row) { return raw[row]; }
  double& spatial_scale(int c) { return raw[layout.scale + c]; }
  void scales(double a, double b, double c) {
    const double s[3] = {a, b, c};
    for (int i = 0; i < 3; ++i) spatial_scale(i) = inverse_softplus(s[i]);
  }
  double& coupling(int i, int k) { return raw[layout.l_triangle + (i + 3) * (i + 2) / 2 + k]; }  // Lqx | Lq
  void query_scale(int i, double s) { raw[layout.scale + 3 + i] = inverse_softplus(s); }

  // Couples long axes to the query less, by the ratio that they are longer: the conditional mean stays in the
  // image.
  void loosen(std::initializer_list<int> axes, double ratio) {
    for (int i = 0; i < layout.query; ++i)
      for (const int k : axes) coupling(i, k) *= std::min(1.0, 10 / ratio);
  }

  void place(const Camera& camera, double z, double slope = 0.3) {
    const double p[3] = {z * uniform(g, -slope, slope), z * uniform(g, -slope, slope), z};
    for (int c = 0; c < 3; ++c) {
      raw[c] = 0;
      for (int i = 0; i < 3; ++i) raw[c] += camera.rotation[3 * i + c] * p[i];
    }
    const double rho = std::hypot(raw[0], raw[1], raw[2]);
    for (int i = 0; i < layout.query; ++i) query[i] = i < 3 && layout.query >= 3 ? raw[i] / rho : camera.time;
  }
  void random(double size) {
    for (int c = 0; c < 3; ++c) raw[layout.rgb + c] = uniform(g, 0.2, 0.9);
    raw[layout.opacity] = uniform(g, -1, 1);
    raw[layout.beta] = uniform(g, -0.5, 0.5);
    for (int i = 0; i < layout.query; ++i) raw[layout.query_beta + i] = uniform(g, -1, 0.5);
    for (int r = layout.l_triangle; r < layout.count; ++r) raw[r] = uniform(g, -0.5, 0.5);
    scales(size * uniform(g, 0.5, 1), size * uniform(g, 0.5, 1), size * uniform(g, 0.5, 1));
    for (int i = 0; i < layout.query; ++i) query_scale(i, uniform(g, 0.5, 1));
  }
  double scale(int k) const {
    const double s = raw[layout.scale + k];
    return s > 20 ? s : std::log1p(std::exp(s));
  }
  // Row i of B, of skew_nd (I + A) diag(s), and the length of what stands beside the scale of its own.
  std::vector<double> query_row(int i) {
    std::vector<double> row(layout.dim);
    const bool skew = layout.variant.cov_param == CovParam::skew_nd;
    double square = 0;
    for (int k = 0; k < layout.dim; ++k) {
      if (k < i + 3) row[k] = skew ? -coupling(i, k) * scale(k) : coupling(i, k);
      if (skew && k > i + 3) row[k] = coupling(k - 3, i + 3) * scale(k);
      square += row[k] * row[k];
    }
    const double least =
        layout.variant.cov_mode == CovMode::whiten ? UBS_QUERY_SCALE_WHITEN : UBS_QUERY_SCALE_RELATIVE;
    row[i + 3] = std::max(scale(i + 3), least * std::sqrt(square));  // the clamp
    return row;
  }
  // Query means at a distance of the query: x = distance B xi with random xi, so that |y| is about
  // `distance`. B has the scales that are used: not below the clamp.
  void means(double distance) {
    double xi[11];
    for (double& v : xi) v = uniform(g, -1, 1);
    for (int i = 0; i < layout.query; ++i) {
      const std::vector<double> row = query_row(i);
      double x = 0;
      for (int k = 0; k < layout.dim; ++k) x += row[k] * xi[k];
      raw[layout.mean + i] = query[i] - distance * x;
    }
  }
  SweepSplat finish(double radius2 = 0.95) const {
    SweepSplat splat{{}, radius2};
    for (const double v : raw) splat.raw.push_back(static_cast<float>(v));
    return splat;
  }

  ParameterLayout layout;
  std::vector<double> raw;
  std::array<double, 8> query{};
  Generator& g;
};

// `shape` sets what differs from an ordinary splat at depth 3.
template <typename Shape>
SweepSet ordinary(int dim, int count, Generator& g, const Shape& shape, const ModelVariant& variant = {}) {
  SweepSet set{dim, sweep_camera(&g), {}, {}, variant};
  for (int i = 0; i < count; ++i) {
    Draft d(dim, g, variant);
    d.place(set.camera, 3);
    d.random(0.1);
    double radius2 = 0.95;
    shape(d, set, radius2);
    set.splats.push_back(d.finish(radius2));
  }
  return set;
}

SweepSet beta(double x, int count, Generator& g) {
  return ordinary(6, count, g, [x](Draft& d, SweepSet&, double& radius2) {
    d.at(d.layout.beta) = std::log(x / 4);
    d.means(0.5);
    radius2 =
        std::min(0.95, 4 / std::min(x, 4 * std::exp(UBS_BETA_RAW_MAX)));  // where there is anything to see
  });
}

SweepSet query_beta(double x, int count, Generator& g) {
  return ordinary(7, count, g, [x](Draft& d, SweepSet&, double&) {
    for (int i = 0; i < d.layout.query; ++i) d.at(d.layout.query_beta + i) = std::log(x / 4);
    d.means(std::min(1.0, 0.5 / std::sqrt(x)));
  });
}

// Rows of B of very different length, but of different directions.
SweepSet graded(double x, int count, Generator& g) {
  return ordinary(7, count, g, [x](Draft& d, SweepSet&, double&) {
    for (int i = 0; i < d.layout.query; ++i) {
      const double s = std::pow(x, -0.5 * i / 3);
      d.query_scale(i, s);
      for (int k = 0; k < i + 3; ++k) d.coupling(i, k) *= s;
    }
    d.means(0.5);
  });
}

constexpr ModelVariant kWhiten{.cov_mode = CovMode::whiten}, kSkewNd{.cov_param = CovParam::skew_nd},
    kCholesky{.cov_param = CovParam::cholesky};

// Couplings of order 1 with small own scales.
void couple(Draft& d, double x) {
  for (int i = 0; i < d.layout.query; ++i) {
    d.query_scale(i, 1 / std::sqrt(x));
    for (int k = 3; k < i + 3; ++k) d.coupling(i, k) /= std::sqrt(x);
  }
}

// Sigma_q has rank three but for the scales, and the splat is thin given its query.
template <ModelVariant variant = ModelVariant{}>
SweepSet coupled(double x, int count, Generator& g) {
  return ordinary(
      7, count, g,
      [x](Draft& d, SweepSet&, double&) {
        couple(d, x);
        d.means(0.5);
      },
      variant);
}

SweepSet time_coupled(double x, int count, Generator& g) {
  return ordinary(4, count, g, [x](Draft& d, SweepSet&, double&) {
    d.query_scale(0, 1 / std::sqrt(x));
    d.means(0.5);
  });
}

// A splat that covers hundreds of pixels, thin in every direction given its query.
template <ModelVariant variant = ModelVariant{}>
SweepSet coupled_large(double x, int count, Generator& g) {
  return ordinary(
      6, count, g,
      [x](Draft& d, SweepSet&, double&) {
        d.scales(2, 1.5, 1);
        for (int i = 0; i < d.layout.query; ++i)
          d.at(d.layout.query_beta + i) = uniform(d.g, 0, 0.5);  // weights of 1: V stays definite
        couple(d, x);
        d.means(0.1);
      },
      variant);
}

// The same with weights below 1, by 1e-6 to 0.1: of one splat all alike, of the next different by up to a
// tenth of that (more makes many covariances indefinite).
template <ModelVariant variant = ModelVariant{}>
SweepSet coupled_weights(double x, int count, Generator& g) {
  return ordinary(
      6, count, g,
      [x](Draft& d, SweepSet& set, double&) {
        const bool alike = set.splats.size() % 2 == 0;
        const double below = std::pow(10, uniform(d.g, -6, -1));
        d.scales(2, 1.5, 1);
        for (int i = 0; i < d.layout.query; ++i)
          d.at(d.layout.query_beta + i) = std::log1p(-below * (alike ? 1 : uniform(d.g, 0.9, 1.1)));
        couple(d, x);
        d.means(0.1);
      },
      variant);
}

// The same with one weight of 1 and others 1e-3 to 0.9 below: neither form of K is made for both.
SweepSet whiten_mixed(double x, int count, Generator& g) {
  return ordinary(
      6, count, g,
      [x](Draft& d, SweepSet&, double&) {
        const auto one = static_cast<int>(d.g() % 3);
        d.scales(2, 1.5, 1);
        for (int i = 0; i < d.layout.query; ++i)
          d.at(d.layout.query_beta + i) = i == one ? 0.1 : std::log1p(-std::pow(10, uniform(d.g, -3, -0.05)));
        couple(d, x);
        d.means(0.1);
      },
      kWhiten);
}

// A large splat that moves with the time: a weight of 1, or up to 1e-4 below it, for the time, small weights
// for directions that are hardly coupled.
SweepSet coupled_motion(double x, int count, Generator& g) {
  return ordinary(7, count, g, [x](Draft& d, SweepSet&, double&) {
    d.scales(2, 1.5, 1);
    for (int i = 0; i < 3; ++i) {
      d.at(d.layout.query_beta + i) = uniform(d.g, -4, -1);
      for (int k = 0; k < i + 3; ++k) d.coupling(i, k) *= 1e-4;
    }
    d.at(d.layout.query_beta + 3) = d.g() % 2 ? uniform(d.g, 0, 0.5) : -std::pow(10, uniform(d.g, -8, -4));
    for (int k = 3; k < 6; ++k) d.coupling(3, k) *= 1e-4;
    d.query_scale(3, 1 / std::sqrt(x));
    d.means(0.1);
  });
}

// Of (I + A) diag(s), the query columns of the spatial rows as long as the short axes.
SweepSet skew_needle(double x, int count, Generator& g) {
  return ordinary(
      6, count, g,
      [x](Draft& d, SweepSet&, double&) {
        d.scales(0.004 * x, 0.004, 0.004);
        for (int i = 0; i < d.layout.query; ++i)
          for (int k = 0; k < 3; ++k) d.coupling(i, k) *= 0.01;
        d.loosen({0}, x);
        d.means(0.5);
      },
      kSkewNd);
}

// One query scale, the others of order 1, short against what the spatial columns give its row.
SweepSet skew_coupled(double x, int count, Generator& g) {
  return ordinary(
      7, count, g,
      [x](Draft& d, SweepSet&, double&) {
        d.scales(0.3, 0.2, 0.25);
        d.query_scale(3, 1 / std::sqrt(x));
        for (int i = 0; i < 3; ++i)
          for (int k = 0; k < 3; ++k) d.coupling(i, k) *= 0.1;
        d.means(0.5);
      },
      kSkewNd);
}

// The time column of (I + A) diag(s) makes the spatial rows, hundreds of px: given the time the splat is x
// times shorter.
SweepSet skew_motion(double x, int count, Generator& g) {
  return ordinary(
      4, count, g,
      [x](Draft& d, SweepSet&, double&) {
        d.scales(2 / x, 1.5 / x, 1 / x);
        d.query_scale(0, 2);
        for (int k = 0; k < 3; ++k) d.coupling(0, k) = (d.g() % 2 ? 1 : -1) * uniform(d.g, 0.3, 1);
        d.at(d.layout.query_beta) = uniform(d.g, 0, 0.5);
        d.means(0.1);
      },
      kSkewNd);
}

template <ModelVariant variant = ModelVariant{}>
SweepSet needle(double x, int count, Generator& g) {
  return ordinary(
      6, count, g,
      [x](Draft& d, SweepSet&, double&) {
        d.scales(0.004 * x, 0.004, 0.004);
        d.loosen({0}, x);
        d.means(0.5);
      },
      variant);
}

// The Cholesky factor of a needle: its long axis is the first column.
SweepSet cholesky_needle(double x, int count, Generator& g) {
  return ordinary(
      6, count, g,
      [x](Draft& d, SweepSet&, double&) {
        d.scales(0.004 * x, 0.004, 0.004);
        const int entries = d.layout.l_triangle;
        d.at(entries) *= 0.008 * x, d.at(entries + 1) *= 0.008 * x, d.at(entries + 2) *= 0.008;
        d.loosen({0}, x);
        d.means(0.5);
      },
      kCholesky);
}

SweepSet needle_flat(double x, int count, Generator& g) {
  return ordinary(3, count, g, [x](Draft& d, SweepSet&, double&) { d.scales(0.004, 0.004 * x, 0.002); });
}

// The long axis on the camera's axis, up to 0.02 rad beside it.
SweepSet needle_depth(double x, int count, Generator& g) {
  SweepSet set{6, sweep_camera(nullptr), {}, {}};
  for (int i = 0; i < count; ++i) {
    Draft d(6, g);
    d.place(set.camera, 3);
    d.random(0.1);
    d.scales(0.01, 0.01, 0.01 * x);
    d.at(d.layout.l_triangle + 1) = uniform(g, -0.02, 0.02);
    d.at(d.layout.l_triangle + 2) = uniform(g, -0.02, 0.02);
    d.loosen({2}, x);
    d.means(0.5);
    set.splats.push_back(d.finish());
  }
  return set;
}

template <ModelVariant variant = ModelVariant{}>
SweepSet disc(double x, int count, Generator& g) {
  return ordinary(
      6, count, g,
      [x](Draft& d, SweepSet&, double&) {
        d.scales(0.004 * x, 0.004, 0.004 * x * uniform(d.g, 0.3, 1));
        d.loosen({0, 2}, x);
        d.means(0.5);
      },
      variant);
}

// x: 1/z; the near plane is taken away, so that the formulas and not the cull are seen.
SweepSet near_camera(double x, int count, Generator& g) {
  SweepSet set = ordinary(6, count, g, [x](Draft& d, SweepSet& s, double&) {
    d.place(s.camera, 1 / x);
    d.scales(0.05, 0.1, 0.07);
    for (int i = 0; i < d.layout.query; ++i)  // no shift of the conditional mean, which would dwarf z
      for (int k = 0; k < 3; ++k) d.coupling(i, k) = 0;
    d.means(0.5);
  });
  set.settings.near_plane = 1e-8f;
  return set;
}

SweepSet far_away(double x, int count, Generator& g) {
  return ordinary(6, count, g, [x](Draft& d, SweepSet& s, double&) {
    d.place(s.camera, x);
    d.means(0.5);
  });
}

// x: 1 / (1 - o).
SweepSet opaque(double x, int count, Generator& g) {
  return ordinary(6, count, g, [x](Draft& d, SweepSet&, double&) {
    d.at(d.layout.opacity) = std::log(x - 1);
    d.means(0.05);
  });
}

SweepSet omega(double x, int count, Generator& g) {
  return ordinary(6, count, g, [x](Draft& d, SweepSet&, double&) {
    double a[3], norm = 0;
    for (double& v : a) v = uniform(d.g, -1, 1), norm += v * v;
    for (int k = 0; k < 3; ++k) d.at(d.layout.l_triangle + k) = x * a[k] / std::sqrt(norm);
    d.means(0.5);
  });
}

SweepSet query_distance(double x, int count, Generator& g) {
  return ordinary(7, count, g, [x](Draft& d, SweepSet&, double&) {
    for (int i = 0; i < d.layout.query; ++i) {
      d.at(d.layout.query_beta + i) = uniform(d.g, -4, -2);      // so that the floor is to be seen, not zero
      for (int k = 0; k < 3; ++k) d.coupling(i, k) *= 0.01 / x;  // the mean stays in the image
    }
    d.means(x);
  });
}

// A scene of constant size whose origin is x away.
SweepSet world(double x, int count, Generator& g) {
  SweepSet set{6, sweep_camera(nullptr), {}, {}};
  const double offset[3] = {static_cast<float>(x), static_cast<float>(-0.7 * x), static_cast<float>(0.3 * x)};
  for (int c = 0; c < 3; ++c) set.camera.translation[c] = -offset[c];
  for (int i = 0; i < count; ++i) {
    Draft d(6, g);
    d.place(set.camera, 3);
    d.random(0.1);
    d.means(0.5);
    for (int c = 0; c < 3; ++c) d.raw[c] += offset[c];
    set.splats.push_back(d.finish());
  }
  return set;
}

SweepSet scale(double x, int count, Generator& g) {
  return ordinary(6, count, g, [x](Draft& d, SweepSet&, double&) {
    for (int i = 0; i < d.layout.query; ++i)
      for (int k = 0; k < 3; ++k) d.coupling(i, k) *= std::min(1.0, 0.1 / x);  // the mean stays in the image
    d.scales(x, 0.7 * x, 0.5 * x);
    d.means(0.5);
  });
}

std::vector<float> stack_splat(Generator& g, double opacity, double beta, double size) {
  const double l00 = 1 / (size * uniform(g, 0.5, 1)), l11 = 1 / (size * uniform(g, 0.5, 1));
  std::vector<float> fields;
  for (const double v :
       {uniform(g, -0.1, 0.1) * size, uniform(g, -0.1, 0.1) * size, l00, 0.5 * l00 * uniform(g, -1, 1), l11,
        opacity, beta, uniform(g, 0.2, 0.9), uniform(g, 0.2, 0.9), uniform(g, 0.2, 0.9)})
    fields.push_back(static_cast<float>(v));
  return fields;
}

std::vector<SweepStack> stacks_of(int count, Generator& g, int layers, double size, auto splat) {
  std::vector<SweepStack> stacks(static_cast<std::size_t>(count));
  for (SweepStack& stack : stacks) {
    for (int k = 0; k < layers; ++k) {
      const std::vector<float> fields = splat();
      stack.fields.insert(stack.fields.end(), fields.begin(), fields.end());
    }
    for (int k = 0; k < kSweepPoints; ++k) {
      stack.x.push_back(static_cast<float>(uniform(g, -0.3, 0.3) * size));
      stack.y.push_back(static_cast<float>(uniform(g, -0.3, 0.3) * size));
    }
  }
  return stacks;
}

// x: 1 / (1 - o) of each of 12 layers.
std::vector<SweepStack> opaque_layers(double x, int count, Generator& g) {
  return stacks_of(std::min(count, 4), g, 12, 10,
                   [&] { return stack_splat(g, 1 - 1 / x, uniform(g, 0.02, 0.5), 10); });
}

// x layers, together nearly opaque.
std::vector<SweepStack> many_layers(double x, int count, Generator& g) {
  const int layers = std::max(1, static_cast<int>(std::lround(x)));
  return stacks_of(std::min(count, 2), g, layers, 10,
                   [&] { return stack_splat(g, std::min(0.9, 8.0 / layers), uniform(g, 0.2, 1), 10); });
}

// One splat about 0, so that the points have all their digits.
SweepStack rim_splat(Generator& g, int i) {
  SweepStack stack;
  stack.fields = stack_splat(g, 0.5, std::array{0.2, 0.5, 1.0, 4.0}[static_cast<std::size_t>(i) % 4], 10);
  stack.fields[0] = stack.fields[1] = 0;
  return stack;
}

// Adds the point at this r and a random angle.
void add_point(const SweepStack& stack, double r, Generator& g, std::vector<float>& x,
               std::vector<float>& y) {
  const double l00 = stack.fields[2], l01 = stack.fields[3], l11 = stack.fields[4];
  const double radius = std::sqrt(r), angle = uniform(g, 0, 6.283185307);
  y.push_back(static_cast<float>(radius * std::sin(angle) / l11));
  x.push_back(static_cast<float>((radius * std::cos(angle) - l01 * y.back()) / l00));
}

// x: 1 / (1 - r). Errors of the pixel itself, which is no norm over a footprint.
std::vector<SweepStack> rim_pixel(double x, int count, Generator& g) {
  std::vector<SweepStack> stacks;
  for (int i = 0; i < std::min(count, 8); ++i) {
    SweepStack stack = rim_splat(g, i);
    for (int k = 0; k < kSweepPoints; ++k) add_point(stack, 1 - 1 / x, g, stack.x, stack.y);
    stacks.push_back(std::move(stack));
  }
  return stacks;
}

// The part of the support with 1 - r < 1/x, which is 1/x of its area, against all of it; points in the middle
// of equal shares of the area.
std::vector<SweepStack> rim(double x, int count, Generator& g) {
  std::vector<SweepStack> stacks;
  for (int i = 0; i < std::min(count, 8); ++i) {
    SweepStack stack = rim_splat(g, i);
    stack.share = 1 / x;
    for (int k = 0; k < kSweepPoints; ++k) {
      const double share = (k + 0.5) / kSweepPoints;
      add_point(stack, 1 - share / x, g, stack.x, stack.y);
      add_point(stack, share, g, stack.whole_x, stack.whole_y);
    }
    stacks.push_back(std::move(stack));
  }
  return stacks;
}

}  // namespace

const std::vector<SweepCase>& sweep_cases() {
  static const std::vector<SweepCase> cases{
      {"beta", "exponent of the spatial kernel", "beta = 4 exp(raw), raw -12 .. 12", 4 * std::exp(-12.0),
       4 * std::exp(12.0), 13, beta, nullptr},
      {"query_beta", "exponents of the query dimensions, N = 7", "beta = 4 exp(raw), raw -12 .. 12",
       4 * std::exp(-12.0), 4 * std::exp(12.0), 13, query_beta, nullptr},
      {"graded", "Sigma_q with rows of different length, N = 7", "condition number of Sigma_q", 1, 1e12, 13,
       graded, nullptr},
      {"coupled", "Sigma_q of rank 3 but for s_q, N = 7", "1 / s_q^2 (about the condition number)", 1, 1e12,
       13, coupled, nullptr},
      {"coupled_large", "the same of a large splat, N = 6", "1 / s_q^2", 1, 1e12, 13, coupled_large<>,
       nullptr},
      {"coupled_weights", "the same with weights a little below 1", "1 / s_q^2", 1, 1e12, 13,
       coupled_weights<>, nullptr},
      {"coupled_motion", "a large splat in motion, N = 7", "1 / s_t^2", 1, 1e12, 13, coupled_motion, nullptr},
      {"coupled_time", "time coupled to the position, N = 4", "1 / s_t^2", 1, 1e12, 13, time_coupled,
       nullptr},
      {"needle", "needle, any orientation", "ratio of the axes", 1, 1e7, 15, needle<>, nullptr},
      {"needle_3d", "needle, N = 3", "ratio of the axes", 1, 1e7, 15, needle_flat, nullptr},
      {"needle_depth", "needle along the line of sight", "ratio of the axes", 1, 1e7, 15, needle_depth,
       nullptr},
      {"disc", "disc, any orientation", "ratio of the axes", 1, 1e7, 15, disc<>, nullptr},
      {"whiten_needle", "needle, cov_mode whiten", "ratio of the axes", 1, 1e7, 15, needle<kWhiten>, nullptr,
       false},
      {"cholesky_needle", "needle, cov_param cholesky", "ratio of the diagonal", 1, 1e7, 15, cholesky_needle,
       nullptr, false},
      {"whiten_coupled", "coupled, cov_mode whiten", "1 / s_q^2", 1, 1e12, 13, coupled<kWhiten>, nullptr,
       false},
      {"whiten_large", "coupled_weights, cov_mode whiten", "1 / s_q^2", 1, 1e12, 13, coupled_weights<kWhiten>,
       nullptr, false},
      {"whiten_mixed", "whiten_large, weights of 1 and below", "1 / s_q^2", 1, 1e12, 13, whiten_mixed,
       nullptr, false},
      {"skew_needle", "needle, skew_nd", "ratio of the axes", 1, 1e7, 15, skew_needle, nullptr, false},
      {"skew_coupled", "small query scales, skew_nd, N = 7", "1 / s_q^2", 1, 1e12, 13, skew_coupled, nullptr,
       false},
      {"skew_motion", "a large splat in motion, skew_nd, N = 4", "s_t / s_x", 1, 1e6, 13, skew_motion,
       nullptr, false},
      {"near", "distance to the camera, no near plane", "1 / z", 0.1, 1e6, 15, near_camera, nullptr},
      {"far", "distance to the camera", "z", 1, 1e4, 9, far_away, nullptr},
      {"opacity", "base opacity", "1 / (1 - o)", 1.1, 1e8, 11, opaque, nullptr},
      {"omega", "skew parameters", "|omega|", 1e-3, 10, 9, omega, nullptr},
      {"query_distance", "query far from its mean, N = 7", "|y|", 1e-3, 1e4, 15, query_distance, nullptr},
      {"world", "distance of the scene from the origin", "coordinate", 1, 1e7, 8, world, nullptr},
      {"scale", "spatial scale at depth 3", "scale", 1e-7, 1e4, 12, scale, nullptr},
      {"opaque_layers", "12 layers, opacity to 1", "1 / (1 - o)", 1.1, 1e7, 8, nullptr, opaque_layers},
      {"many_layers", "many layers", "layers", 1, 256, 9, nullptr, many_layers},
      {"rim_pixel", "one pixel at the rim, beta 0.2 .. 4", "1 / (1 - r)", 1.1, 1e7, 15, nullptr, rim_pixel},
      {"rim", "the rim as a share of the splat", "1 / (1 - r), the share's inverse", 1.1, 1e7, 15, nullptr,
       rim},
  };
  return cases;
}

}  // namespace ubs::stress
