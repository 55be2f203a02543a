// SPDX-License-Identifier: Apache-2.0
// Tests training with variants of the method: the loss decreases, and repeated runs are bit-identical.
#include <algorithm>
#include <catch2/catch.hpp>

#include "host/settings/fields.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/variants.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

// The variants that are trained by default, with their numbers of dimensions: one for each parameter layout,
// and one for each combination of settings whose kernels differ in structure. With UBS_TEST_ALL=1, all
// variants are trained. tests/pipeline/variant_test.cpp compares renders and gradients of variants with
// float64.
constexpr std::pair<std::string_view, int> kSample[] = {
    {"no query betas", 6}, {"DBS", 3}, {"skew_nd whiten sh2 antialias", 7}, {"direct", 6}, {"direct 6DGS", 6},
    {"3DGS", 3},           {"7DGS", 7}};

std::vector<test::NamedVariant> trained_variants() {
  std::vector<test::NamedVariant> variants = test::named_variants();
  if (test::whole_sweep()) return variants;
  std::erase_if(variants, [](const test::NamedVariant& v) {
    return !std::ranges::count(kSample, std::pair<std::string_view, int>(v.name, v.dim));
  });
  REQUIRE(variants.size() == std::size(kSample));
  return variants;
}

TrainSettings settings_of(const test::NamedVariant& v) {
  TrainSettings settings = test::short_run(v.dim, 80, 250);
  settings.cap_max = 300;
  settings.query_grad = v.query_grad;
  const auto fields = bind_fields(settings, train_fields());
  for (const auto& [key, value] : non_default_switches(v.variant)) set_field(fields, key, value, "test");
  return settings;
}

TEST_CASE("training of variants decreases the loss, with the same bits in two runs", "[training][variants]") {
  const test::Data data = test::synthetic("glossy", 32, 8), moving = test::synthetic("orbit", 32, 8);
  for (const auto& device : devices_under_test())
    for (const test::NamedVariant& v : trained_variants()) {
      DYNAMIC_SECTION(device->info().name << ", " << v.name << ", N = " << v.dim) {
        const test::Data& scene = v.dim == 7 ? moving : data;
        const test::Outcome first = test::train(*device, settings_of(v), scene);
        const test::Outcome second = test::train(*device, settings_of(v), scene);
        WARN(v.name << " N = " << v.dim << ": loss " << first.losses.front() << " -> "
                    << first.losses.back());
        CHECK(first.losses.back() < 0.85 * first.losses.front());
        CHECK(first.model.count == 300);
        CHECK(first.model.variant == v.variant);
        CHECK(test::same_bits(first.model.values, second.model.values));
      }
    }
}

TEST_CASE("a model whose variant differs from the settings is rejected", "[training][variants]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = test::short_run(6, 10, 100);
    settings.variant.kernel = SpatialKernel::gaussian;
    CHECK_THROWS_WITH(Trainer(*device, settle(settings), data.train, data.test, initialise_random(6, 100, 1)),
                      Catch::Contains("'default'") && Catch::Contains("kernel gaussian"));
  }
}

}  // namespace
}  // namespace ubs
