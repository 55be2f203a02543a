// SPDX-License-Identifier: Apache-2.0
// Tests that the comparison with the oracle detects errors. Each mutation below changes a term of a formula
// in a copy of the kernel sources, nearly always by 1 %. Most of the formulas are those of the backward pass.
// The comparison must then find an error above its bound.
#include <catch2/catch.hpp>
#include <filesystem>

#include "host/lab/oracle/oracle.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "tests/support/changed_kernels.hpp"
#include "tests/support/compare.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/oracle_scene.hpp"
#include "tests/support/set_variable.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

struct Mutation {
  const char* file;
  const char* original;
  const char* mutant;
};

// Each mutation needs a compilation, so only every second one is run, which includes at least one per file.
// With UBS_TEST_ALL=1, all are run. The test also fails if the original text of a mutation is not in the
// sources.
constexpr Mutation kMutations[] = {
    {"math/blend.h", "sums.opacity += a.falloff * v_alpha;",
     "sums.opacity += V(1.01) * a.falloff * v_alpha;"},
    {"math/blend.h", "sums.log_beta += h * slopes.beta;", "sums.log_beta += V(1.01) * h * slopes.beta;"},
    {"math/blend.h", "return remaining - step.weight *", "return remaining - V(1.01) * step.weight *"},
    {"math/blend.h", "sums.r += step.weight * v_r;", "sums.r += V(1.01) * step.weight * v_r;"},
    {"math/blend.h", "sums.hpq += hp * a.q;", "sums.hpq += V(1.01) * hp * a.q;"},
    {"math/blend.h", "real twice = R(-2.0)", "real twice = R(-2.02)"},
    {"math/projection.h", "inv_z * v_j02", "V(1.01) * inv_z * v_j02"},
    {"math/projection.h", "v_p.e[1] + along)", "v_p.e[1] + V(1.01) * along)"},
    {"math/blend.h", "f.square = s.beta;", "f.square = R(1.01) * s.beta;"},
    {"math/ellipse.h", "y[i][r] = V(2.0) * y[i][r];", "y[i][r] = V(2.02) * y[i][r];"},
    {"math/ellipse.h", "wh.e[1][c] = w.w01", "wh.e[1][c] = V(1.01) * w.w01"},
    {"math/ellipse.h", "t[1][r] = V(2.0) *", "t[1][r] = V(2.02) *"},
    {"math/splat.h", "v_m.e[r][c] += p.r.e[r] * s.conditional.offset.e[c];",
     "v_m.e[r][c] += V(1.01) * p.r.e[r] * s.conditional.offset.e[c];"},
    {"math/ellipse.h", "s01 = V(0.25) *", "s01 = V(0.3) *"},
    {"math/covariance.h", "v.rotation[1] = v_m.e[0][2] * f.scale.e[2]",
     "v.rotation[1] = V(1.01) * v_m.e[0][2] * f.scale.e[2]"},
    {"math/splat.h", "vreal v_beta = bq < V(0.0) ? ", "vreal v_beta = bq < V(0.0) ? V(1.01) * "},
    {"math/conditional.h", "v_u.e[i] = s.z.e[i] * v_k.e[c];", "v_u.e[i] = V(1.01) * s.z.e[i] * v_k.e[c];"},
    {"math/conditional.h", "v_yw.e[i] -= s.q[i][r]", "v_yw.e[i] -= V(1.01) * s.q[i][r]"},
    {"math/conditional.h", "f.e[i][j] = sum;", "f.e[i][j] = V(1.01) * sum;"},
    {"math/conditional.h", "V(-4.0) * ubs_sigmoid", "V(-4.04) * ubs_sigmoid"},
};

struct Scenes {
  oracle::Scene scene;
  oracle::Gradient expected;
};

Scenes make_scene() {
  Scenes s{oracle::regular_scene({.count = 200, .dim = 5, .seed = 5, .width = 61, .height = 45}), {}};
  s.expected = oracle::gradient(oracle::to_model(s.scene.model), s.scene.camera, s.scene.target,
                                {.background = s.scene.background});
  return s;
}

// Returns the largest relative error of all parameter groups. The kernels are built from the sources in the
// folder UBS_KERNEL_DIR, if this environment variable is set.
double worst_group_error(const Scenes& s) {
  // The kernels of other back ends are compiled ahead of time, but use the same formulas.
  const std::unique_ptr<Device> device = open_device("opencl");
  const auto stages = make_stages(*device, {.dim = s.scene.model.dim});
  const ViewGradient actual = view_gradient(*device, *stages, s.scene.model, s.scene.camera,
                                            test::target_of(s.scene), test::settings_of(s.scene), 0.2f);
  double worst = 0;
  for (const ParameterGroup& group : parameter_groups(s.scene.model.layout())) {
    const std::size_t first = static_cast<std::size_t>(group.first) * s.scene.model.count;
    const std::size_t size = static_cast<std::size_t>(group.count) * s.scene.model.count;
    worst = std::max(worst, test::relative_error(std::span(actual.values.values).subspan(first, size),
                                                 std::span(s.expected.values).subspan(first, size)));
  }
  return worst;
}

TEST_CASE("the comparison with the oracle detects small errors in formulas of the kernels", "[mutation]") {
  const Scenes s = make_scene();
  // The same bound as for the gradient of the regular scene with N = 5 in oracle_comparison_test.cpp.
  constexpr double kBound = 4.0e-5;
  CHECK(worst_group_error(s) < kBound);
  for (std::size_t n = 0; n < std::size(kMutations); ++n) {
    const Mutation& m = kMutations[n];
    const test::TempFolder folder;
    const std::filesystem::path kernels = test::changed_kernels(folder, m.file, m.original, m.mutant);
    if (n % 2 != 0 && !test::whole_sweep()) continue;
    const test::Variable from_there("UBS_KERNEL_DIR", kernels.c_str());
    const double error = worst_group_error(s);
    INFO(m.file << ": " << m.mutant);
    CHECK(error > kBound);
  }
}

}  // namespace
}  // namespace ubs
