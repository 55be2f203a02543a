// SPDX-License-Identifier: Apache-2.0
// Every variant of the method trains: the loss falls, and the same run gives the same bits.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>

#include "host/spec/settings.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/variants.hpp"

namespace ubs {
namespace {

TrainSettings settings_of(const test::NamedVariant& v) {
  TrainSettings settings = test::short_run(v.dim, 80, 250);
  settings.cap_max = 300;
  settings.query_grad = v.query_grad;
  const auto fields = bind_fields(settings, train_fields());
  for (const auto& [key, value] : non_default_switches(v.variant)) set_field(fields, key, value, "test");
  return settings;
}

void check_same_bits(const SplatModel& a, const SplatModel& b) {
  REQUIRE(a.values.size() == b.values.size());
  CHECK(std::memcmp(a.values.data(), b.values.data(), a.values.size() * sizeof(float)) == 0);
}

TEST_CASE("every variant learns, twice to the same bits", "[training][variants]") {
  const test::Data data = test::synthetic("glossy", 32, 8), moving = test::synthetic("orbit", 32, 8);
  for (const auto& device : devices_under_test())
    for (const test::NamedVariant& v : test::named_variants()) {
      DYNAMIC_SECTION(device->info().name << ", " << v.name << ", N = " << v.dim) {
        const test::Data& scene = v.dim == 7 ? moving : data;
        const test::Outcome first = test::train(*device, settings_of(v), scene);
        const test::Outcome second = test::train(*device, settings_of(v), scene);
        WARN(v.name << " N = " << v.dim << ": loss " << first.losses.front() << " -> "
                    << first.losses.back());
        CHECK(first.losses.back() < 0.85 * first.losses.front());
        CHECK(first.model.count == 300);
        CHECK(first.model.variant == v.variant);
        check_same_bits(first.model, second.model);
      }
    }
}

TEST_CASE("a model of another form than the settings is refused", "[training][variants]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = test::short_run(6, 10, 100);
    settings.variant.kernel = SpatialKernel::gaussian;
    CHECK_THROWS_WITH(Trainer(*device, settings, data.train, data.test, initialise_random(6, 100, 1)),
                      Catch::Contains("'default'") && Catch::Contains("kernel gaussian"));
  }
}

}  // namespace
}  // namespace ubs
