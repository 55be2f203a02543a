// SPDX-License-Identifier: Apache-2.0
// This file tests that examine() detects faults and reports the right kind of fault. For this, correct
// results of a device are changed before they are compared.
#include <catch2/catch.hpp>
#include <cmath>

#include "host/base/error.hpp"
#include "tests/stress/row.hpp"

namespace ubs::stress {
namespace {

// Increases the gradient of one parameter of the last splat by one percent, as a wrong backward formula might
// do.
void disturb_gradient(const Case& c, DeviceResult& result) {
  if (c.model.count == 0 || result.gradient.count == 0) return;
  result.gradient.row(c.model.layout().opacity)[c.model.count - 1] *= 1.01f;
}

TEST_CASE_METHOD(Row, "a gradient that is wrong by one percent is detected", "[judge]") {
  DeviceRunner faulty(device(), runner().raster());
  const Case c = ordinary_case("whole", 6, 12);
  REQUIRE(examine(c, faulty).outcome == Outcome::float64);
  faulty.disturb = disturb_gradient;
  const Verdict failed = examine(c, faulty);
  CHECK(failed.outcome == Outcome::failed);
  CHECK(failed.fault == Fault::gradient);
  CHECK(failed.worst_group == "opacity");
  CHECK_THAT(failed.problem, Catch::Contains("opacity"));
}

TEST_CASE_METHOD(Row, "wrong images, NaN, colours out of range and gradients of culled splats are detected",
                 "[judge]") {
  DeviceRunner faulty(device(), runner().raster());
  Case c = ordinary_case("faults", 3, 4);
  c.model.row(2)[1] = -5;  // the splat is behind the camera
  const auto fault_of = [&](auto disturb) {
    faulty.disturb = disturb;
    return examine(c, faulty).fault;
  };
  CHECK(fault_of([](const Case&, DeviceResult&) {}) == Fault::none);
  CHECK(fault_of([](const Case&, DeviceResult& r) {
          for (float& v : r.image) v *= 1.005f;
        }) == Fault::image);
  CHECK(fault_of([](const Case&, DeviceResult& r) { r.image[5] = NAN; }) == Fault::image_not_finite);
  CHECK(fault_of([](const Case&, DeviceResult& r) { r.image[5] = 7; }) == Fault::outside_colours);
  CHECK(fault_of([](const Case&, DeviceResult& r) { r.gradient.values[3] = INFINITY; }) ==
        Fault::gradient_not_finite);
  CHECK(fault_of([](const Case&, DeviceResult& r) { r.gradient.row(7)[1] = 1e-20f; }) ==
        Fault::culled_gradient);
  CHECK(fault_of([](const Case&, DeviceResult&) { fail(ErrorKind::memory, "no"); }) == Fault::refused);
}

}  // namespace
}  // namespace ubs::stress
