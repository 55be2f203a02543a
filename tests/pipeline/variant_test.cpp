// SPDX-License-Identifier: Apache-2.0
// Compares whole views of variants of the method (docs/variants.md) on every device with the float64 oracle,
// which implements the variants independently of the kernels. By default, a sample of the variants is tested.
// With UBS_TEST_ALL=1, all of them are tested with every rasteriser.
#include <algorithm>
#include <catch2/catch.hpp>
#include <set>

#include "host/base/error.hpp"
#include "tests/pipeline/oracle_comparison.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/variants.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

// Variants that are tested with the CUDA back end on the host. They cover every part of the projection that
// CUDA compiles differently: both spatial kernels, and all parameterisations of the covariance.
constexpr std::string_view kOnHost[] = {"3DGS", "6DGS", "skew_nd whiten sh2 antialias", "direct gaussian"};

// Variants (with their numbers of dimensions) that are only tested with UBS_TEST_ALL=1, because they are
// redundant: the other variants contain every value of every setting that selects a variant, and tests/math
// tests each variant separately.
constexpr std::pair<std::string_view, int> kElsewhere[] = {{"quaternion", 3},
                                                           {"cholesky", 3},
                                                           {"cholesky", 6},
                                                           {"skew_nd", 6},
                                                           {"beta_cond off", 7},
                                                           {"beta_opacity none", 6},
                                                           {"beta_opacity gaussian", 7},
                                                           {"whiten", 7},
                                                           {"kernel gaussian", 6},
                                                           {"sh2", 3},
                                                           {"sh3", 3},
                                                           {"antialias", 6},
                                                           {"7DGS", 7},
                                                           {"direct", 4},
                                                           {"direct", 5}};
// Variants whose rasteriser or colours differ from those of other variants. Only they are also tested with
// the GPU rasteriser on devices that have both rasterisers.
constexpr std::string_view kSecondRaster[] = {"DBS", "3DGS", "direct 6DGS"};

// Returns a scene whose splats have raw spatial betas of at least -0.5, which is a beta of 2.4. A smaller
// beta makes the rim of a splat so steep that three digits of float32 are lost in all variants, which would
// hide errors of formulas. The regular scenes of oracle_comparison_test.cpp also contain smaller betas.
oracle::Scene variant_scene(const test::NamedVariant& v) {
  oracle::Scene scene = oracle::regular_scene({.count = 200,
                                               .dim = v.dim,
                                               .seed = 20 + static_cast<std::uint64_t>(v.dim),
                                               .width = 61,
                                               .height = 45,
                                               .variant = v.variant});
  if (v.variant.has_spatial_beta())
    for (float& b : scene.model.row(scene.model.layout().beta)) b = std::max(b, -0.5f);
  return scene;
}

// Returns the values that occur in these variants: pairs of the index of a setting in variant_numbers() and
// its value.
std::set<std::pair<std::size_t, int>> values_of(const std::vector<test::NamedVariant>& variants) {
  std::set<std::pair<std::size_t, int>> values;
  for (const test::NamedVariant& v : variants) {
    const auto numbers = variant_numbers(v.variant);
    for (std::size_t s = 0; s < numbers.size(); ++s) values.insert({s, numbers[s]});
  }
  return values;
}

std::vector<test::NamedVariant> variants_of_all_dims() {
  std::vector<test::NamedVariant> variants = test::named_variants();
  for (const int dim : {4, 5, 11})
    variants.push_back({"direct", dim, {.conditioning = Conditioning::direct}});
  if (test::whole_sweep()) {
    variants.insert(variants.end(), {{"taylor2", 6, {.rot_mode = RotMode::taylor2}},
                                     {"cayley", 6, {.rot_mode = RotMode::cayley}},
                                     {"sb3", 7, {.colour = ColourMode::sb3}}});
    return variants;
  }
  std::vector<test::NamedVariant> sample = variants;
  std::erase_if(sample, [](const test::NamedVariant& v) {
    return std::ranges::count(kElsewhere, std::pair<std::string_view, int>(v.name, v.dim)) > 0;
  });
  REQUIRE(sample.size() + std::size(kElsewhere) == variants.size());
  REQUIRE(values_of(sample) == values_of(variants));
  return sample;
}

TEST_CASE("variants agree with float64", "[oracle][variants]") {
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device))
      for (const test::NamedVariant& v : variants_of_all_dims()) {
        if (on_host(*device) && !std::ranges::count(kOnHost, v.name)) continue;
        // The rasteriser only depends on the spatial kernel of the variant, so the GPU rasteriser is tested
        // with a few variants if the device also has the CPU rasteriser.
        if (rasters_of(*device).size() > 1 && raster == RasterKind::gpu && !test::whole_sweep() &&
            !std::ranges::count(kSecondRaster, v.name))
          continue;
        DYNAMIC_SECTION(device->info().name << ", raster " << test::text(raster) << ", " << v.name
                                            << ", N = " << v.dim) {
          KernelConfig config;
          config.dim = v.dim;
          config.raster = raster;
          config.query_grad = v.query_grad;
          config.variant = v.variant;
          const test::Case c{*device, config, ""};
          const oracle::Scene scene = variant_scene(v);
          // The largest errors observed are 1.6e-6 for alpha, and 2.4e-6 for the gradient of xyz.
          test::compare_forward(c, "variant " + v.name, scene, 3.2e-6);
          test::compare_gradient(c, "variant " + v.name, scene, 4.8e-6);
        }
      }
}

TEST_CASE("incompatible settings of a variant are rejected", "[variants]") {
  for (const auto& device : devices_under_test()) {
    KernelConfig config;
    config.dim = 6;
    config.variant.rot_mode = RotMode::quaternion;
    CHECK_THROWS_WITH(make_stages(*device, config), Catch::Contains("quaternion needs dim = 3"));
    config.variant = {.rot_mode = RotMode::exp, .cov_param = CovParam::cholesky};
    CHECK_THROWS_WITH(make_stages(*device, config),
                      Catch::Contains("only applies to cov_param = spatial_ortho"));
  }
}

}  // namespace
}  // namespace ubs
