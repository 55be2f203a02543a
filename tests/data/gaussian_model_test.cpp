// SPDX-License-Identifier: Apache-2.0
// Tests models of Gaussians with spherical harmonics: the conversion from third-party splats and back, the
// conversion from every parametrisation of the covariance, and the reduction to three dimensions, which keeps
// the harmonics.
#include "host/formats/gaussian_model.hpp"

#include "host/formats/ply.hpp"
#include "host/formats/reduce_splats.hpp"
#include "host/formats/splat_file.hpp"
#include "host/scene/initialise.hpp"
#include "tests/support/splats.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

Mat3 covariance_of(const SplatModel& model, std::size_t i) {
  const Matrix3 m = spatial_factor(model, i).m;
  Mat3 c{};
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = 0; b < 3; ++b)
      for (std::size_t k = 0; k < 3; ++k) c[a][b] += m[a][k] * m[b][k];
  return c;
}

Mat3 covariance_of(const ImportedSplats& s, std::size_t i) {
  const auto& q = s.rotations[i];
  const auto& l = s.log_scales[i];
  return ubs::test::covariance_of({q[0], q[1], q[2], q[3]},
                                  {std::exp(double{l[0]}), std::exp(double{l[1]}), std::exp(double{l[2]})});
}

SplatModel random_model(const ModelVariant& variant) {
  SplatModel model(3, 40, variant);
  const CounterRandom random(4, 2);
  for (int r = 0; r < model.layout().count; ++r)
    for (std::uint32_t i = 0; i < 40; ++i)
      model.row(r)[i] = static_cast<float>(random.uniform(i, static_cast<std::uint32_t>(r), -1.5, 1.5));
  return model;
}

}  // namespace

TEST_CASE("gaussian model: third-party splats are restored; only rotations and scales have rounding errors",
          "[gaussian]") {
  TempFolder folder;
  for (const int degree : {0, 1, 2, 3}) {
    const ImportedSplats splats = random_splats(200, degree);
    const SplatModel model = exact_model(splats);
    CHECK(model.variant.colour == static_cast<ColourMode>(degree + 1));
    CHECK(is_gaussian_model(model));
    write_splat_ply(folder / "u.ply", model);
    CHECK(detect_splat_format(folder / "u.ply").name == "ubs");
    const ImportedSplats back = to_imported_splats(read_splat_ply(folder / "u.ply"));
    const Differences d = compare(splats, back);
    CHECK(d.position == 0);
    CHECK(d.rotation < 1e-6);
    CHECK(d.opacity == 0);
    CHECK(d.dc == 0);
    CHECK(d.rest == 0);
    CHECK(d.log_scale < 1e-6);  // observed difference: 5e-7
  }
}

TEST_CASE("gaussian model: every kind of covariance is converted to scales and a quaternion", "[gaussian]") {
  std::vector<ModelVariant> variants;
  for (const RotMode mode :
       {RotMode::taylor1, RotMode::taylor2, RotMode::cayley, RotMode::exp, RotMode::quaternion})
    variants.push_back({.rot_mode = mode, .kernel = SpatialKernel::gaussian});
  variants.push_back({.cov_param = CovParam::cholesky, .kernel = SpatialKernel::gaussian});
  variants.push_back(
      {.cov_param = CovParam::skew_nd, .kernel = SpatialKernel::gaussian, .colour = ColourMode::sh1});
  for (const ModelVariant& variant : variants) {
    INFO(to_string(variant));
    const SplatModel model = random_model(variant);
    const ImportedSplats out = to_imported_splats(model);
    REQUIRE(out.count() == model.count);
    CHECK(out.sh_degree == (variant.colour == ColourMode::sh1 ? 1 : 0));
    double worst = 0;
    for (std::size_t i = 0; i < out.count(); ++i)
      worst = std::max(worst, relative_difference(covariance_of(model, i), covariance_of(out, i)));
    CHECK(worst < 2e-6);
    if (variant.colour == ColourMode::rgb)
      CHECK(0.5 + kShC0 * out.sh[4] == Approx(model.row(model.layout().rgb + 1)[1]).epsilon(1e-5));
  }
}

TEST_CASE("gaussian model: DBS splats keep their kernel, and antialiased splats their compensation",
          "[gaussian]") {
  ImportedSplats dbs = random_splats(3, 0);
  dbs.kernel = SpatialKernel::beta;
  dbs.betas = {0.1f, -0.2f, 0.3f};
  const SplatModel model = exact_model(dbs);
  CHECK(to_string(model.variant) == "rot_mode quaternion, colour sh0");
  CHECK(model.row(model.layout().beta)[1] == -0.2f);
  CHECK(!is_gaussian_model(model));
  dbs.lobes = 2;
  dbs.resize(3);
  for (std::size_t k = 0; k < dbs.sb.size(); ++k) dbs.sb[k] = 0.1f * static_cast<float>(k);
  const SplatModel lobes = exact_model(dbs);
  CHECK(to_string(lobes.variant) == "rot_mode quaternion, colour sb2");
  CHECK(lobes.layout().property_names()[6 + 11] == "sb_params_11");
  CHECK(lobes.row(lobes.layout().rgb + 3 + 11)[2] == dbs.sb[35]);
  TempFolder folder;
  write_gaussian_ply(folder / "dbs.ply", to_imported_splats(lobes));
  CHECK(detect_splat_format(folder / "dbs.ply").name == "dbs");
  const ImportedSplats back = read_foreign_splats(folder / "dbs.ply");
  CHECK(back.report.notes.empty());
  CHECK(back.sb == dbs.sb);
  CHECK(back.betas == dbs.betas);
  CHECK(back.sh == dbs.sh);
  ImportedSplats filtered = random_splats(3, 1);
  filtered.antialiased = true;
  CHECK(exact_model(filtered).variant.antialias == Antialias::on);
  CHECK(to_imported_splats(exact_model(filtered)).antialiased);
}

TEST_CASE("gaussian model: reduction keeps harmonics and Gaussian sizes, and rejects unsupported variants",
          "[gaussian]") {
  SplatModel model(6, 20, {.kernel = SpatialKernel::gaussian, .colour = ColourMode::sh2});
  const ParameterLayout l = model.layout();
  for (std::size_t i = 0; i < 20; ++i) {
    model.row(l.scale)[i] = -1, model.row(l.scale + 1)[i] = -2, model.row(l.scale + 2)[i] = -3;
    for (int k = 0; k < 3; ++k) model.row(l.query_beta + k)[i] = -8;
    for (int k = 0; k < 27; ++k) model.row(l.rgb + k)[i] = static_cast<float>(k);
  }
  const ImportedSplats out = reduce_splats(model);
  REQUIRE(out.count() == 20);
  CHECK(out.sh_degree == 2);
  CHECK(out.sh[2] == 2);  // the constant terms of all channels, followed by the other terms of red
  CHECK(out.sh[3] == 3);
  CHECK(out.sh[4] == 3 + 8);
  CHECK(std::exp(out.log_scales[0][0]) == Approx(softplus_of(-1)).epsilon(1e-5));
  SplatModel cholesky(6, 1, {.cov_param = CovParam::cholesky});
  CHECK_THAT(message_of([&] { reduce_splats(cholesky); }, ErrorKind::usage), Contains("cholesky"));
}

TEST_CASE("gaussian model: load_splat_model() also reads third-party files", "[gaussian]") {
  TempFolder folder;
  write_spz(folder / "a.spz", random_splats(30, 2));
  const LoadedModel exact = load_splat_model(folder / "a.spz");
  CHECK(exact.model.variant().colour == ColourMode::sh2);
}
