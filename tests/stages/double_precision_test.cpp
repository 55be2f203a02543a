// SPDX-License-Identifier: Apache-2.0
// Compiles the projection kernels in double precision, on devices that support this, and compares their
// results with those of the same formulas compiled for the host. The remaining differences are caused by the
// two compilers and their elementary functions.
#include <catch2/catch.hpp>

#include "host/lab/oracle/scenes.hpp"
#include "host/opencl/opencl_device.hpp"
#include "tests/math/shared_math.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

constexpr std::uint32_t kCount = 193, kSplatsStride = 256;

struct Inputs {
  std::vector<double> params, camera, v_records;
};

Inputs make_inputs() {
  const oracle::Scene scene = oracle::regular_scene({.count = kCount, .dim = UBS_N, .seed = 3});
  Inputs in;
  in.params.assign(static_cast<std::size_t>(kRowCount) * kSplatsStride, 0.0);
  for (int k = 0; k < kRowCount; ++k)
    std::copy_n(scene.model.row(k).begin(), kCount,
                in.params.begin() + k * static_cast<std::ptrdiff_t>(kSplatsStride));
  in.camera.assign(kCameraStride, 0.0);
  const Camera& c = scene.camera;
  std::copy(c.rotation.begin(), c.rotation.end(), in.camera.begin() + kCameraRotation);
  const auto centre = c.centre();
  std::copy(centre.begin(), centre.end(), in.camera.begin() + kCameraCentre);
  const double intrinsics[] = {
      c.fx, c.fy, c.cx, c.cy, static_cast<double>(c.width), static_cast<double>(c.height)};
  std::copy(std::begin(intrinsics), std::end(intrinsics), in.camera.begin() + kCameraFocal);
  in.camera[kCameraQuery] = c.time;
  Random random(5);
  in.v_records.resize(static_cast<std::size_t>(kCount) * kGradStride);
  for (double& v : in.v_records) v = random.uniform(-1, 1);
  return in;
}

CameraView camera_view(const std::vector<double>& c) {
  CameraView cam{};
  for (int i = 0; i < 9; ++i) cam.rotation[i / 3][i % 3] = c[kCameraRotation + i];
  for (int i = 0; i < 3; ++i) cam.centre[i] = c[kCameraCentre + i];
  for (int i = 0; i < kCameraQueryMax; ++i) cam.query[i] = c[kCameraQuery + i];
  cam.fx = c[kCameraFocal], cam.fy = c[kCameraFocal + 1];
  cam.cx = c[kCameraPrincipal], cam.cy = c[kCameraPrincipal + 1];
  cam.width = c[kCameraSize], cam.height = c[kCameraSize + 1];
  cam.near_plane = 0.01, cam.far_plane = 1e10, cam.eps2d = 0.3;
  return cam;
}

SplatRaw splat(const Inputs& in, std::uint32_t i) {
  SplatRaw raw;
  for (int k = 0; k < kRowCount; ++k) raw.e[k] = in.params[static_cast<std::size_t>(k) * kSplatsStride + i];
  return raw;
}

double relative_difference(double a, double b) { return std::abs(a - b) / std::max(1.0, std::abs(b)); }

TEST_CASE("double-precision kernels agree with the host", "[stages]") {
  const Inputs in = make_inputs();
  const CameraView cam = camera_view(in.camera);
  for (const auto& device : devices_under_test()) {
    auto* opencl_device = dynamic_cast<opencl::OpenclDevice*>(device.get());
    if (!opencl_device || !device->info().has_double) {
      WARN("SKIPPED: " << device->info().name << " is not an OpenCL device with double precision");
      continue;
    }
    const opencl::ProgramSpec spec{
        {"math/rotation.h", "math/covariance.h", "math/conditional.h", "math/direct.h", "math/ellipse.h",
         "math/projection.h", "math/colour.h", "math/falloff.h", "math/reach.h", "math/splat.h",
         "map/records.h", "map/arrays.h", "map/project.cl"},
        {fmt::format("-DUBS_N={}", UBS_N), "-DUBS_VW=1", "-DUBS_REAL_DOUBLE=1"}};
    Buffer<double> params(*device, "params", in.params.size()), camera(*device, "camera", in.camera.size());
    Buffer<double> records(*device, "records", static_cast<std::size_t>(kSplatsStride) * kSplatStride);
    Buffer<double> v_records(*device, "v_records", in.v_records.size()),
        v_params(*device, "v_params", in.params.size());
    Buffer<std::uint32_t> keys(*device, "keys", kSplatsStride), rects(*device, "rects", 2 * kSplatsStride),
        counts(*device, "counts", kSplatsStride);
    params.upload(in.params);
    camera.upload(in.camera);
    v_records.upload(in.v_records);
    const opencl::Range items{opencl::round_up(kCount, 16)}, group{16};
    opencl_device->kernel(spec, "project_forward")(items, group, params.view(), kCount, kSplatsStride, 0u,
                                                   camera.view(), 0u, 0.01, 1e10, 0.3, records.view(),
                                                   keys.view(), rects.view(), counts.view());
    opencl_device->kernel(spec, "project_backward")(items, group, params.view(), kCount, kSplatsStride, 0u,
                                                    camera.view(), 0u, 0.01, 1e10, 0.3, v_records.view(),
                                                    v_params.view(), 0u);
    const std::vector<double> record = records.download(), gradient = v_params.download();
    const std::vector<std::uint32_t> drawn = counts.download();
    double forward = 0, backward = 0;
    int checked = 0;
    for (std::uint32_t i = 0; i < kCount; ++i) {
      if (drawn[i] == 0) continue;
      ++checked;
      const SplatRaw raw = splat(in, i);
      const SplatImage s = splat_image(raw, splat_state(cam, raw, view_ray_ahead(cam, raw), 1));
      REQUIRE(s.valid);
      const double* r = &record[static_cast<std::size_t>(i) * kSplatStride];
      const double expected[] = {s.x, s.y, s.conic.l00, s.conic.l01, s.conic.l11, s.opacity, s.beta,
                                 s.r, s.g, s.b,         s.hx,        s.hy,        s.depth};
      for (int k = 0; k <= kSplatDepth; ++k)
        forward = std::max(forward, relative_difference(r[k], expected[k]));
      const double* v = &in.v_records[static_cast<std::size_t>(i) * kGradStride];
      const SplatRaw g = splat_vjp(cam, raw, view_ray_ahead(cam, raw),
                                   {v[0], v[1], {v[2], v[3], v[4]}, v[5], v[6], v[7], v[8], v[9]}, 1);
      for (int k = 0; k < kRowCount; ++k)
        backward = std::max(
            backward, relative_difference(gradient[static_cast<std::size_t>(k) * kSplatsStride + i], g.e[k]));
    }
    REQUIRE(checked > 50);
    WARN(device->info().name << ": double against host: forward " << forward << ", backward " << backward);
    CHECK(forward < 7.7e-15);   // the largest difference observed is 3.9e-15 (PoCL)
    CHECK(backward < 5.1e-15);  // the largest difference observed is 2.6e-15 (PoCL)
  }
}

}  // namespace
}  // namespace ubs
