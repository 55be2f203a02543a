// SPDX-License-Identifier: Apache-2.0
// This file contains the stress tests (row.hpp) of image sizes, numbers of splats, equal depths, and
// coordinates far from the origin.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "host/base/error.hpp"
#include "host/device/stage_sizes.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/pipeline/slot_store.hpp"
#include "tests/stress/row.hpp"

namespace ubs::stress {
namespace {

TEST_CASE_METHOD(Row, "one covers all: one splat covers an image of 3840x2160 pixels", "[view]") {
  Case c = row_case("covers", 3, 1);
  c.camera.width = 3840, c.camera.height = 2160, c.camera.cx = 1920, c.camera.cy = 1080;
  c.camera.fx = c.camera.fy = 3840;
  SplatPlan plan;
  plan.scale = {40, 50, 0.5}, plan.omega = 0;
  put_splat(c, 0, plan);
  CHECK(runner().run(c, {}).totals.intersections == 240u * 135u);  // the splat is listed in every tile
  // Compare a crop of the centre, because the oracle takes a minute for the whole image.
  c.camera.width = c.camera.height = 64, c.camera.cx = c.camera.cy = 30;
  check_case(c);
}

// There are more intersections than gradient slots that fit on the device. This must give an error that
// contains the number of intersections.
TEST_CASE_METHOD(Row, "too many: more intersections than the device has memory for", "[view]") {
  const std::uint64_t tiles = 240 * 135;
  const DeviceInfo& info = device().info();
  // The slots of the GPU rasteriser are smaller than those of the CPU rasteriser, so more of them fit.
  const unsigned floats = stage_sizes::slot_floats(RasterKind::gpu);
  const std::uint64_t most =
      std::min(SlotStore::most(info, floats), info.memory_bytes / (floats * sizeof(float)));
  const std::uint64_t splats = std::min<std::uint64_t>(most, std::uint64_t{1} << 32) / tiles + 2;
  Case c = row_case("too_many", 3, static_cast<std::size_t>(splats));
  c.camera.width = 3840, c.camera.height = 2160, c.camera.cx = 1920, c.camera.cy = 1080;
  SplatPlan plan;
  plan.scale = {1e4, 1e4, 0.5}, plan.omega = 0;
  for (std::size_t i = 0; i < c.model.count; ++i) put_splat(c, i, plan);
  try {
    runner().run(c, pixel_weights(c));
    WARN(splats << " splats over " << tiles << " tiles fit into the memory of this device");
  } catch (const Error& error) {
    CHECK(error.kind() == ErrorKind::memory);
    CHECK_THAT(error.what(), Catch::Contains(std::to_string(splats * tiles)));
  }
}

TEST_CASE_METHOD(Row, "image sizes: from 1x1 to 8191x1 and 7680x40 pixels", "[view]") {
  constexpr int kSizes[][2] = {{1, 1},   {17, 3},   {3, 65},   {16, 16},
                               {15, 17}, {8191, 1}, {1, 4097}, {7680, 40}};
  for (const int dim : {3, 6})
    for (const auto& size : kSizes) {
      Case c = row_case(fmt::format("size.{}x{}", size[0], size[1]), dim, 12);
      c.camera.width = size[0], c.camera.height = size[1];
      c.camera.cx = size[0] / 2.0, c.camera.cy = size[1] / 2.0;
      for (std::size_t i = 0; i < 12; ++i) {
        SplatPlan plan;
        const double across = (static_cast<double>(i) / 11 - 0.5) * size[0] / 32;
        plan.position = {2 * across, 0.05 * (static_cast<double>(i) - 6) * size[1] / 32, 2};
        put_splat(c, i, plan);
      }
      check_case(c);
    }
}

// The image has about 130 000 tiles, and the test renders all of them. There is one splat near each corner.
TEST_CASE_METHOD(Row, "large image: 7680x4320 pixels", "[view]") {
  Case c = row_case("8k", 6, 4);
  c.camera.width = 7680, c.camera.height = 4320, c.camera.cx = 3840, c.camera.cy = 2160;
  c.camera.fx = c.camera.fy = 7680;
  const double places[4][2] = {{5, 5}, {7674, 4}, {6, 4314}, {7673, 4313}};
  for (std::size_t i = 0; i < 4; ++i) {
    SplatPlan plan;
    plan.position = {(places[i][0] - 3840) / 7680 * 2, (places[i][1] - 2160) / 7680 * 2, 2};
    plan.scale = {0.002, 0.003, 0.002}, plan.coupling = 0.001, plan.opacity_raw = 3;
    put_splat(c, i, plan);
  }
  const DeviceResult result = runner().run(c, {});
  const std::size_t pixels = result.alpha.size();
  std::size_t wrong = 0, touched = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    touched += result.alpha[i] > 0;
    const bool finite = std::isfinite(result.image[i]) && std::isfinite(result.image[pixels + i]) &&
                        std::isfinite(result.image[2 * pixels + i]);
    wrong +=
        !finite || (result.alpha[i] == 0 && std::abs(result.image[i] - c.settings.background[0]) > 1e-6f);
  }
  CHECK(wrong == 0);  // counts pixels that are not finite, or differ from the background without a splat
  CHECK(touched > 40);
  CHECK(touched < 4000);
  // Compare each corner alone with float64.
  for (std::size_t i = 0; i < 4; ++i) {
    Case corner = c;
    corner.name = fmt::format("8k.corner{}", i);
    corner.camera.width = corner.camera.height = 24;
    corner.camera.cx -= std::min(7656.0, std::max(0.0, places[i][0] - 12));
    corner.camera.cy -= std::min(4296.0, std::max(0.0, places[i][1] - 12));
    check_case(corner);
  }
}

TEST_CASE_METHOD(Row, "few splats: no splats, no visible splats, and one splat", "[view]") {
  for (const int dim : kRowDims) {
    check_case(row_case("none", dim, 0));
    check_case(row_case("one", dim, 1));
    Case c = row_case("behind", dim, 5);
    for (float& z : c.model.row(2)) z = -5;
    check_case(c);
  }
}

TEST_CASE_METHOD(Row, "crowded tile: 20 000 splats in one tile", "[view]") {
  for (const int dim : {3, 6}) {
    Case c = row_case("crowded", dim, 20000);
    c.camera.width = c.camera.height = 20, c.camera.cx = c.camera.cy = 8;
    Random random(3);
    for (std::size_t i = 0; i < c.model.count; ++i) {
      SplatPlan plan;
      const double z = random.uniform(2, 4);
      plan.position = {random.uniform(-0.25, 0.25) * z, random.uniform(-0.25, 0.25) * z, z};
      plan.scale = {0.06, 0.08, 0.05};
      plan.opacity_raw = random.uniform(-7, -4);
      plan.coupling = 0.02, plan.query_offset = 0.1;
      put_splat(c, i, plan);
    }
    check_case(c);
  }
}

TEST_CASE_METHOD(Row, "equal depths: 40 splats are ordered by their index", "[view]") {
  for (const int dim : kRowDims) {
    Case c = row_case("equal_depths", dim, 40);
    for (std::size_t i = 0; i < 40; ++i) {
      SplatPlan plan;
      plan.position = {0.05 * static_cast<double>(i % 8) - 0.2, 0.05 * static_cast<double>(i / 8) - 0.1, 2};
      plan.coupling = 0;  // the conditional mean equals the mean, so depths are bit-identical
      put_splat(c, i, plan);
    }
    check_case(c);
  }
}

TEST_CASE_METHOD(Row, "far coordinates: camera and splats at 1e5 to 1e7 from the origin", "[view]") {
  for (const int dim : kRowDims)
    for (const double far : {1e5, 1e6, 1e7}) {
      Case c = row_case("far", dim, 8);
      const std::array<double, 3> centre{far, -far, 0.5 * far};
      for (std::size_t k = 0; k < 3; ++k) c.camera.translation[k] = -centre[k];
      for (std::size_t i = 0; i < 8; ++i) {
        SplatPlan plan;
        const double z = 40 + 8 * static_cast<double>(i);
        plan.position = {centre[0] + 4 * static_cast<double>(i) - 16, centre[1] + 2, centre[2] + z};
        plan.scale = {8, 10, 6}, plan.coupling = 3;
        put_splat(c, i, plan);
      }
      check_case(c);
    }
}

}  // namespace
}  // namespace ubs::stress
