// SPDX-License-Identifier: Apache-2.0
// This file contains the stress tests (row.hpp) of parameters and positions of single splats. Each test
// compares several cases with float64.
#include <catch2/catch.hpp>
#include <cfloat>
#include <cmath>

#include "host/base/error.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "tests/stress/row.hpp"

namespace ubs::stress {
namespace {

// The depths of the splats are exact in single precision, because the camera is at the origin and is not
// rotated, and because without coupling the conditional mean equals the mean.
TEST_CASE_METHOD(Row, "near plane: splats at depth 0, +-1e-8, the near plane, and one ulp beside it",
                 "[splat]") {
  const float near = 0.01f;
  for (const int dim : kRowDims)
    for (const double z :
         {0.0, 1e-8, -1e-8, static_cast<double>(near), static_cast<double>(std::nextafter(near, 1.0f)),
          static_cast<double>(std::nextafter(near, 0.0f)), 0.011, 0.02, -1.0}) {
      Case c = row_case("near", dim, 2);
      SplatPlan plan;
      plan.position = {0, 0, z}, plan.scale = {0.002, 0.003, 0.001}, plan.coupling = 0,
      plan.query_offset = 0.1;
      put_splat(c, 0, plan);
      c.exact = true;
      INFO("N = " << dim << ", z = " << z);
      CHECK(check_case(c).drawn == (static_cast<float>(z) >= near ? 2 : 1));
    }
}

TEST_CASE_METHOD(Row, "beside the frustum: elongated splats with x/z or y/z of up to 1e4", "[splat]") {
  for (const int dim : kRowDims)
    for (const double slope : {0.64, 0.66, 1.0, 10.0, 100.0, 1e3, 1e4})
      for (const bool vertical : {false, true}) {
        Case c = row_case("beside", dim, 2);
        SplatPlan plan;
        const double z = 0.5;
        plan.position = {vertical ? 0.1 : slope * z, vertical ? -slope * z : 0.1, z};
        plan.scale = {2 * slope * z, 0.5 * slope * z, 0.3};
        put_splat(c, 0, plan);
        check_case(c);
      }
}

TEST_CASE_METHOD(Row, "principal point: up to 3000 pixels outside an image of 32x24 pixels", "[splat]") {
  for (const int dim : kRowDims)
    for (const auto& [x, y] : {std::pair{-100.0, 12.0}, {200.0, -50.0}, {0.0, 0.0}, {3000.0, 3000.0}}) {
      Case c = row_case("principal", dim, 4);
      c.camera.cx = x, c.camera.cy = y;
      for (std::size_t i = 0; i < 4; ++i) {
        SplatPlan plan;
        const double z = 2 + 0.25 * static_cast<double>(i);
        plan.position = {(10.0 + 4.0 * static_cast<double>(i) - x) / 32 * z, (12 - y) / 32 * z, z};
        put_splat(c, i, plan);
      }
      check_case(c);
    }
}

// eps2d makes splats at least about half a pixel thick in the image, so thin axes only matter if splats are
// large in the image. Therefore, the splats are also rendered with 32 times the focal length.
TEST_CASE_METHOD(Row, "needles: splats whose scales have ratios of 1e1 to 1e7", "[splat]") {
  for (const int dim : kRowDims)
    for (const double zoom : {1.0, 32.0})
      for (const double ratio : {1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7}) {
        Case c = row_case(fmt::format("needle.{:g}.{:.0e}", zoom, ratio), dim, 3);
        c.camera.fx *= zoom, c.camera.fy *= zoom;
        for (std::size_t i = 0; i < 2; ++i) {
          SplatPlan plan;
          plan.position = {(0.2 - 0.3 * static_cast<double>(i)) / zoom, 0.1 / zoom,
                           2 + static_cast<double>(i)};
          plan.scale = {1, 1 / ratio, i == 0 ? 1 / ratio : 0.5};
          plan.omega = 0.6;
          put_splat(c, i, plan);
        }
        check_case(c);
      }
}

// A splat with a raw scale of -inf is not rendered. A splat with a raw scale of -200 is rendered with a
// radius of half a pixel, because of eps2d.
TEST_CASE_METHOD(Row, "zero scales: one to three spatial scales or the query scales are 0 (raw -inf or -200)",
                 "[splat]") {
  for (const int dim : kRowDims)
    for (const int zeros : {1, 2, 3, 4}) {
      Case c = row_case("zero_scale", dim, 2);
      SplatPlan plan;
      for (std::size_t k = 0; k < 3; ++k)
        if (static_cast<int>(k) < zeros) plan.scale[k] = 0;
      plan.position = {-0.03125, -0.03125, 2};  // half a pixel off the axis, at a pixel centre
      if (zeros == 4) plan = {}, plan.query_scale = 0, plan.coupling = 0;
      put_splat(c, 0, plan);
      check_case(c);
      for (float& v : c.model.values)
        if (v == -static_cast<float>(kInfinity)) v = -200;
      check_case(c);
    }
}

TEST_CASE_METHOD(Row, "zero rows: all parameters of a splat are 0, or its quaternion is 0", "[splat]") {
  for (const int dim : kRowDims) {
    Case c = row_case("zero_row", dim, 3);
    c.camera.translation = {0, 0, 2};  // so that the splat at the origin is in front of the camera
    for (int row = 0; row < c.model.layout().count; ++row) c.model.row(row)[0] = 0;
    check_case(c);
  }
  Case c = row_case("zero_quaternion", 3, 2, {.rot_mode = RotMode::quaternion});
  for (int row = c.model.layout().l_triangle; row < c.model.layout().count; ++row) c.model.row(row)[0] = 0;
  check_case(c);
}

// For large raw values, the opacity rounds to 1. Alpha is limited to 0.999, so blending stops at the second
// layer.
TEST_CASE_METHOD(Row, "opaque layers: 60 splats behind each other, with opacities of up to 1", "[splat]") {
  for (const int dim : kRowDims)
    for (const double raw : {3.0, 6.90675478, 8.0, 17.0, 100.0, kInfinity}) {
      Case c = row_case("opaque", dim, 60);
      for (std::size_t i = 0; i < 60; ++i) {
        SplatPlan plan;
        plan.opacity_raw = raw, plan.beta_raw = -4, plan.query_offset = 0, plan.query_beta_raw = -6;
        plan.position = {0.01 * static_cast<double>(i % 7), 0, 2 + 0.0625 * static_cast<double>(i)};
        put_splat(c, i, plan);
      }
      check_case(c);
    }
}

TEST_CASE_METHOD(Row, "faint: opacities from 1/255 to 0", "[splat]") {
  for (const int dim : kRowDims)
    for (const double raw :
         {-5.5373342670185366, -5.54, -8.0, -20.0, -60.0, -90.0, -100.0, -1000.0, -kInfinity}) {
      Case c = row_case("faint", dim, 2);
      SplatPlan plan;
      plan.opacity_raw = raw;
      put_splat(c, 0, plan);
      check_case(c);
    }
  for (const double raw : {-5.5, -5.5373342670185366, -5.6, -30.0}) {
    Case c = row_case("faint_gaussian", 6, 2, {.kernel = SpatialKernel::gaussian});
    SplatPlan plan;
    plan.opacity_raw = raw, plan.scale = {0.1, 0.15, 0.1};
    put_splat(c, 0, plan);
    check_case(c);
  }
}

// One parameter of one of three splats is replaced by a special value. Image and gradients must agree with
// the oracle.
TEST_CASE_METHOD(Row, "poison: a parameter of a splat is NaN, +-inf, +-FLT_MAX, FLT_MIN, denormal or -0",
                 "[splat]") {
  constexpr double kValues[] = {kInfinity, -kInfinity, NAN, FLT_MAX, -FLT_MAX, FLT_MIN, 1e-45, -0.0};
  for (const int dim : {3, 6, 7})
    for (int row = 0; row < ParameterLayout(dim).count; ++row)
      for (const double value : kValues) {
        Case c = row_case(fmt::format("poison.row{}.{}", row, value), dim, 3);
        c.model.row(row)[1] = static_cast<float>(value);
        check_case(c);
      }
}

void check_betas(Row& row, double first, double last) {
  for (const int dim : kRowDims)
    for (double raw = first; raw <= last; raw += 1)
      for (const bool query : {false, true}) {
        if (query && dim == 3) continue;
        Case c = row_case(fmt::format("beta{}.{}", query ? "_query" : "", raw), dim, 3);
        for (std::size_t i = 0; i < 3; ++i) {
          SplatPlan plan;
          (query ? plan.query_beta_raw : plan.beta_raw) = raw;
          plan.query_offset = raw > 4 ? 0.01 : 0.2;
          plan.position = {0.2 * static_cast<double>(i) - 0.2, 0.1, 2 + 0.5 * static_cast<double>(i)};
          put_splat(c, i, plan);
        }
        row.check_case(c);
      }
}

TEST_CASE_METHOD(Row, "low betas: raw spatial or query betas from -12 to -1", "[splat]") {
  check_betas(*this, -12, -1);
}

TEST_CASE_METHOD(Row, "high betas: raw spatial or query betas from 0 to 12", "[splat]") {
  check_betas(*this, 0, 12);
}

// The condition number of the query covariance Sigma_q is about the square of coupling / scale, which is 1 to
// 1e12 here.
TEST_CASE_METHOD(Row, "query condition: query covariances with condition numbers of up to 1e12", "[splat]") {
  for (const int dim : {4, 5, 6, 7})
    for (const double ratio : {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6})
      for (const double raw : {0.0, -1.0, -3.0}) {
        Case c = row_case(fmt::format("condition.{:.0e}.{}", ratio, raw), dim, 3);
        for (std::size_t i = 0; i < 3; ++i) {
          SplatPlan plan;
          plan.coupling = 1, plan.query_scale = 1 / ratio, plan.query_beta_raw = raw;
          plan.query_offset = 0.3 / ratio;
          plan.position = {0.2 * static_cast<double>(i) - 0.2, 0.1, 2 + 0.5 * static_cast<double>(i)};
          put_splat(c, i, plan);
        }
        check_case(c);
      }
}

TEST_CASE_METHOD(Row, "queries: equal or opposite to the mean, at times 0, 1 and outside, and inside a splat",
                 "[splat]") {
  for (const int dim : {4, 6, 7})
    for (const double time : {0.0, 1.0, -1.0, 2.0})
      for (const double offset : {0.0, -1.0}) {  // 0: the mean equals the query; -1: the mean is its negative
        Case c = row_case("query", dim, 2);
        c.camera.time = time;
        SplatPlan plan;
        plan.query_offset = 0;
        put_splat(c, 0, plan);
        const ParameterLayout l = c.model.layout();
        if (offset != 0)
          for (int q = 0; q < l.query; ++q) c.model.row(l.mean + q)[0] *= -1;
        check_case(c);
      }
  for (const int dim : kRowDims)  // the camera is inside the splat, at its mean or close to it
    for (const double z : {0.0, 1e-30, 1e-13, 1e-6, 0.02, 0.3}) {
      Case c = row_case("inside", dim, 2);
      SplatPlan plan;
      plan.position = {0, 0, z}, plan.scale = {1, 1.5, 2};
      put_splat(c, 0, plan);
      check_case(c);
    }
}

TEST_CASE_METHOD(Row, "saturated query: queries at distances of 2 to 1e30 from the mean", "[splat]") {
  for (const int dim : {4, 5, 6, 7})
    for (const double offset : {2.0, 2.88, 2.884, 2.89, 5.0, 100.0, 1e4, 1e10, 1e30})
      for (const double raw : {-5.0, 0.0}) {
        Case c = row_case(fmt::format("saturated.{:.3g}", offset), dim, 2);
        SplatPlan plan;
        plan.query_offset = offset, plan.query_beta_raw = raw, plan.coupling = 0;
        put_splat(c, 0, plan);
        check_case(c);
      }
}

// With conditioning = direct, the query scales are the diagonal entries of the factor L of the precision
// matrix. With 1e3, a splat is visible only if the query differs from the mean by less than a few
// thousandths. The queries are near to and far from the mean, and the conditioning weights range from nearly
// 0 to 1.
TEST_CASE_METHOD(Row, "direct conditioning: diagonal entries of the factor L from 0 to 1e3", "[splat]") {
  for (const int dim : {4, 6, 7})
    for (const double precision : {0.0, 1e-6, 1e-2, 1.0, 10.0, 29.0, 31.0, 1e2, 1e3})
      for (const double offset : {0.0, 0.5, 3.0})
        for (const double raw : {0.0, -1.0, -8.0}) {
          Case c = row_case(fmt::format("direct.{:.0e}.{}.{}", precision, offset, raw), dim, 3,
                            {.conditioning = Conditioning::direct});
          for (std::size_t i = 0; i < 3; ++i) {
            SplatPlan plan;
            plan.query_scale = precision, plan.query_offset = offset / std::max(precision, 1.0);
            plan.query_beta_raw = raw;
            plan.position = {0.2 * static_cast<double>(i) - 0.2, 0.1, 2 + 0.5 * static_cast<double>(i)};
            put_splat(c, i, plan);
          }
          check_case(c);
        }
}

// The radius is 24 / 96 * 8 = 2 pixels, because eps2d is 0. It is exact both in the oracle and in single
// precision, so that both make the same decision at pixels that are exactly on the rim (r = 1).
TEST_CASE_METHOD(Row, "rim and tiles: pixel centres exactly on the rim, and splats on the edges of tiles",
                 "[splat]") {
  for (const double shift : {0.5, 0.0, 16.0, 8.0}) {
    Case c = row_case("rim", 3, 1);
    c.exact = true;
    c.settings.projection.eps2d = 0;
    c.camera.fx = c.camera.fy = 8;
    c.camera.cx = 12 + shift, c.camera.cy = 12.5;
    SplatPlan plan;
    plan.position = {0, 0, 96}, plan.scale = {24, 24, 24}, plan.omega = 0;
    put_splat(c, 0, plan);
    check_case(c);
  }
}

TEST_CASE_METHOD(Row, "a splat with an extreme or invalid parameter is not rendered and has no gradient",
                 "[splat]") {
  const Case good = row_case("range", 6, 3);
  REQUIRE(runner().run(good, {}).totals.visible == 3);
  for (const float value : {1.1e12f, -3.4e38f, -INFINITY, NAN})
    for (int row = 0; row < good.model.layout().count; ++row) {
      Case c = good;
      c.model.row(row)[1] = value;
      const DeviceResult result = runner().run(c, pixel_weights(c));
      INFO("row " << row << " = " << value);
      CHECK(result.totals.visible == 2);
      for (int r = 0; r < c.model.layout().count; ++r) {
        CHECK(result.gradient.row(r)[1] == 0);
        CHECK(std::isfinite(result.gradient.row(r)[0]));
      }
    }
}

}  // namespace
}  // namespace ubs::stress
