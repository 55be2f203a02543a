// SPDX-License-Identifier: Apache-2.0
// Tests the backward pass of the GPU rasteriser with lane exchange: the work-items of a sub-group read each
// other's values directly. It is tested with an emulation in local memory and, if the device supports lane
// exchange, with the functions of the device. Gradients must be bit-identical to those without lane exchange,
// which other tests compare with the oracle.
#include <fmt/format.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "host/device/operation_checks.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/opencl/exchange.hpp"
#include "host/opencl/opencl_device.hpp"
#include "host/opencl/platform.hpp"
#include "host/pipeline/capture_stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "kernels/layout.h"
#include "tests/support/device_fixture.hpp"
#include "tests/support/kernel_folder.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

using namespace opencl;

template <typename T>
std::vector<T> read(Device& device, BufferView<T> view) {
  std::vector<T> values(view.size);
  device.read(*view.memory, 0, std::as_writable_bytes(std::span(values)));
  return values;
}

// Runs the backward pass of the rasteriser and returns the gradient slots. `exchange` is the header with the
// functions for lane exchange: "gpu/exchange.h" or a file that replaces it. Slots with mask 0 are 0.
std::vector<float> backward_by(OpenclDevice& device, const RasterBackward& work, const char* exchange,
                               const Options& options) {
  const test::KernelFolder folder;
  ProgramSpec spec{
      {"dialect/slot_pieces.h", "math/falloff.h", "math/blend.h", "math/cull.h", "opencl/lanes.h",
       "gpu/words.h", exchange, "gpu/list_segments.h", "gpu/tile.h", "gpu/raster_backward.cl"},
      options};
  spec.options.push_back("-DUBS_VW=1");
  Kernel kernel = device.kernel(spec, "raster_gpu_backward");
  Buffer<float> slots(device, "slots", work.slots.pieces[0].size);
  slots.zero();
  const std::size_t group = kTileSide * kTileSide;
  kernel({list_segments(work) * group}, {group}, work.records, work.sorted_ids, work.sorted_slots,
         work.tile_ranges, work.shape.tiles_x(), work.shape.tiles_y(), work.shape.width, work.shape.height,
         work.image, work.v_image, work.masks, work.states, work.more_colours, work.v_more,
         work.more_channels, SlotViews{{slots.view()}, 1, 32});
  return slots.download();
}

TEST_CASE("sums with lane exchange equal those through local memory") {
  const bench::BenchScene scene = bench::synthetic_object(6, 1500, 70, 50, 1);
  for (const auto& device : opencl_devices_under_test()) {
    CaptureStages stages(ubs::make_stages(*device, {.dim = 6, .raster = RasterKind::gpu}));
    DeviceModel model(*device, scene.model, scene.model.count);
    Renderer renderer(*device, stages);
    renderer.set_cameras({scene.views.views[0].camera});
    const std::size_t pairs = renderer.forward(model.view(), 0, {}, true).intersections;
    const std::size_t plane = renderer.shape().plane();
    std::vector<float> v_image(3 * plane, 0.0f);  // the padding remains 0
    for (std::size_t c = 0; c < 3; ++c)
      for (int y = 0; y < 50; ++y)
        for (int x = 0; x < 70; ++x)
          v_image[c * plane + static_cast<std::size_t>(y * renderer.shape().pitch() + x)] =
              std::sin(0.7f * static_cast<float>(x) + 1.3f * static_cast<float>(y) + static_cast<float>(c));
    device->write(*renderer.v_image().memory, 0, std::as_bytes(std::span(v_image)));
    Buffer<float> v_params(*device, "gradients", static_cast<std::size_t>(model.rows()) * model.stride());
    renderer.backward(v_params.view(), false);

    const RasterBackward& work = stages.last<RasterBackward>();
    const std::vector<std::uint16_t> masks = read(*device, work.masks);
    REQUIRE(std::count_if(masks.begin(), masks.begin() + static_cast<std::ptrdiff_t>(pairs),
                          [](std::uint16_t mask) { return mask != 0; }) > 1000);
    auto& opened = dynamic_cast<OpenclDevice&>(*device);
    const std::vector<float> portable = backward_by(opened, work, "gpu/exchange.h", {"-DUBS_SUBGROUPS=0"});
    REQUIRE(std::ranges::any_of(portable, [](float v) { return v != 0; }));
    INFO(device->info().name);
    for (const unsigned lanes : {16u, 32u}) {
      const std::string turn = fmt::format("-DUBS_BACKWARD_TURN={}", lanes);
      for (const unsigned batch : {32u, 128u}) {
        // Tests two of the four combinations, or all of them with UBS_TEST_ALL=1.
        if ((lanes == 16) != (batch == 32) && !test::whole_sweep()) continue;
        CHECK(backward_by(opened, work, "../tests/support/emulated_exchange.h",
                          {"-DUBS_SUBGROUPS=4", turn, fmt::format("-DUBS_BACKWARD_BATCH={}", batch)}) ==
              portable);
      }
      const Exchange own = exchange_kind(opened);
      if (own == Exchange::none) continue;
      Options options = exchange_options(opened, own);
      options.push_back(turn);
      CHECK(backward_by(opened, work, "gpu/exchange.h", options) == portable);
    }
  }
}

TEST_CASE("lane exchange uses the extensions of the device and the matching language version") {
  const char* extensions = "cl_khr_fp64 cl_khr_subgroups cl_khr_il_program";
  const char* features = " __opencl_c_int64 __opencl_c_subgroups __opencl_c_fp64 ";
  CHECK(subgroup_language("OpenCL 3.0 NEO", "", features) == "CL3.0");
  CHECK(subgroup_language("OpenCL 3.0 CUDA", extensions, " __opencl_c_int64 ") == "");
  CHECK(subgroup_language("OpenCL 2.1 AMD-APP", extensions, "") == "CL2.0");
  CHECK(subgroup_language("OpenCL 2.0", "cl_khr_fp64 cl_khr_subgroups_extra", "") == "");
  CHECK(subgroup_language("OpenCL 2.0", "cl_khr_subgroups", "") == "CL2.0");
  CHECK(subgroup_language("OpenCL 1.2 pocl", extensions, features) == "");
  CHECK(exchange_kind("cl_khr_subgroups cl_khr_subgroup_shuffle", "CL3.0") == Exchange::khr);
  CHECK(exchange_kind("cl_khr_subgroups cl_khr_subgroup_shuffle_relative", "CL3.0") == Exchange::none);
  CHECK(exchange_kind("cl_khr_subgroup_shuffle", "") == Exchange::none);
  CHECK(exchange_kind("cl_khr_icd cl_nv_device_attribute_query", "") == Exchange::nvidia);
  CHECK(exchange_kind("cl_khr_subgroups cl_amd_device_attribute_query", "CL2.0") == Exchange::amd);
  CHECK(exchange_kind("cl_khr_fp64", "") == Exchange::none);
}

}  // namespace
}  // namespace ubs
