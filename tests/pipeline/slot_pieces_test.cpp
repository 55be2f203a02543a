// SPDX-License-Identifier: Apache-2.0
// Tests gradient slots that do not fit into a single allocation of the device and are divided into several
// buffers. Gradients must be bit-identical to those with a single buffer. If the slots do not even fit into
// eight buffers or into the memory, the error message must contain the number of slots or intersections. The
// limits are simulated by device objects with smaller limits.
#include <bit>
#include <catch2/catch.hpp>
#include <cmath>

#include "host/base/error.hpp"
#include "host/device/stage_sizes.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/opencl/opencl_device.hpp"
#include "host/pipeline/capture_stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/pipeline/renderer.hpp"
#include "kernels/layout.h"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

constexpr std::uint64_t kSlotBytes = stage_sizes::slot_floats(RasterKind::cpu) * sizeof(float);

// Opens the same device again with a smaller maximum allocation and, if memory_bytes is not 0, with less
// memory.
opencl::OpenclDevice limited(const Device& device, std::uint64_t allocation_bytes,
                             std::uint64_t memory_bytes = 0) {
  const auto& opened = dynamic_cast<const opencl::OpenclDevice&>(device);
  cl_platform_id platform = nullptr;
  REQUIRE(clGetDeviceInfo(opened.id(), CL_DEVICE_PLATFORM, sizeof platform, &platform, nullptr) ==
          CL_SUCCESS);
  DeviceInfo info = device.info();
  info.max_allocation_bytes = allocation_bytes;
  if (memory_bytes > 0) info.memory_bytes = memory_bytes;
  return {platform, opened.id(), info};
}

struct Result {
  std::vector<float> gradient;
  std::uint64_t intersections = 0;
  unsigned pieces = 0;
};

// Renders the view and returns its gradient. If `again` is true, the view is rendered a second time before
// the backward pass, and the capacity of its lists is the one that the first time needed.
Result gradient_of(Device& device, const bench::BenchScene& scene, const KernelConfig& config,
                   bool again = false) {
  CaptureStages capture(make_stages(device, config));
  const DeviceModel model(device, scene.model);
  Renderer renderer(device, capture);
  renderer.set_cameras({scene.views.views[0].camera});
  Result result;
  result.intersections = renderer.forward(model.view(), 0, {}, true).intersections;
  if (again) REQUIRE(renderer.forward_deferred(model.view(), 0, {}).had_capacity());
  std::vector<float> v_image(3 * renderer.shape().plane());
  for (std::size_t i = 0; i < v_image.size(); ++i) v_image[i] = std::sin(0.37f * static_cast<float>(i));
  device.write(*renderer.v_image().memory, 0, std::as_bytes(std::span(v_image)));
  Buffer<float> v_params(device, "gradients", static_cast<std::size_t>(model.rows()) * model.stride());
  v_params.zero();
  renderer.backward(v_params.view(), false);
  result.gradient = v_params.download();
  result.pieces = capture.last<SumSlots>().slots.count;
  return result;
}

// Returns a scene whose splats cover all tiles, so that the slots are by far the largest buffer.
bench::BenchScene wide_splats(std::size_t count = 960) {
  bench::BenchScene scene = bench::random_start(3, count, 64, 64);
  for (const ParameterGroup& group : parameter_groups(scene.model.layout()))
    for (int row = group.first; group.name == "scale" && row < group.first + group.count; ++row)
      for (float& value : scene.model.row(row)) value = 2;
  return scene;
}

TEST_CASE("gradient slots in several buffers give the same bits as in one buffer", "[slots]") {
  for (const auto& device : opencl_devices_under_test())
    for (const RasterKind raster : {RasterKind::cpu, RasterKind::gpu}) {
      KernelConfig config{.dim = 3, .raster = raster};
      // The GPU rasteriser also needs list states of 8 bytes per intersection, which must fit into a single
      // allocation. So its slots can be divided into at most five buffers.
      const bench::BenchScene scene = wide_splats(raster == RasterKind::cpu ? 960 : 600);
      const Result whole = gradient_of(*device, scene, config);
      REQUIRE(whole.pieces == 1);
      INFO(device->info().name << ", " << (raster == RasterKind::cpu ? "cpu" : "gpu") << ", "
                               << whole.intersections << " intersections");
      for (const std::uint64_t shift : {0, 1, 2}) {  // up to 2, 4 and 8 buffers
        const std::uint64_t each = std::bit_floor(whole.intersections - 1) >> shift;
        opencl::OpenclDevice small =
            limited(*device, each * stage_sizes::slot_floats(raster) * sizeof(float));
        const Result parts = gradient_of(small, scene, config, shift == 1);
        CHECK(parts.pieces == (whole.intersections + each - 1) / each);
        CHECK(parts.intersections == whole.intersections);
        CHECK(parts.gradient == whole.gradient);
      }
    }
}

std::string refusal(Device& device, const bench::BenchScene& scene) {
  try {
    gradient_of(device, scene, {.dim = 3});
  } catch (const Error& error) {
    CHECK(error.kind() == ErrorKind::memory);
    return error.what();
  }
  return "no error was thrown";
}

TEST_CASE("gradient slots that exceed all buffers or the memory are rejected with a message", "[slots]") {
  const bench::BenchScene scene = wide_splats();
  for (const auto& device : opencl_devices_under_test()) {
    const std::uint64_t pairs = gradient_of(*device, scene, {.dim = 3}).intersections;
    const std::uint64_t each = std::bit_floor(pairs - 1) >> 3;  // more than eight buffers would be needed
    opencl::OpenclDevice pieces = limited(*device, each * kSlotBytes);
    CHECK_THAT(refusal(pieces, scene), Catch::Contains(std::to_string(pairs) + " intersections"));
    opencl::OpenclDevice memory = limited(*device, pairs * kSlotBytes, pairs * kSlotBytes + (100 << 10));
    CHECK_THAT(refusal(memory, scene), Catch::Contains(std::to_string(pairs) + " gradient slots"));
    opencl::OpenclDevice tiny = limited(*device, pairs * kSlotBytes, pairs * kSlotBytes - 1);
    CHECK_THAT(refusal(tiny, scene), Catch::Contains(std::to_string(pairs) + " intersections"));
  }
}

TEST_CASE("gradient slots: a memory plan reports slots that do not fit", "[slots][plan]") {
  DeviceInfo device;
  device.name = "small";
  device.max_allocation_bytes = std::uint64_t{1} << 30;
  device.memory_bytes = std::uint64_t{64} << 30;
  MemoryQuestion question{.dim = 6, .splats = 1000, .width = 64, .height = 64, .intersections = 100'000'000};
  CHECK(SlotStore::most(device, stage_sizes::slot_floats(RasterKind::cpu)) == std::uint64_t{8} << 24);
  CHECK(memory_shortage(plan_memory(question), device).empty());  // 6.0 GiB of slots in 6 buffers
  question.intersections = 200'000'000;
  CHECK_THAT(memory_shortage(plan_memory(question), device),
             Catch::Contains("'gradient slots' needs 12207 MiB") && Catch::Contains("only 8192 MiB"));
  device.memory_bytes = std::uint64_t{4} << 30;
  question.intersections = 100'000'000;
  CHECK_THAT(memory_shortage(plan_memory(question), device), Catch::Contains("the run needs"));
}

}  // namespace
}  // namespace ubs
