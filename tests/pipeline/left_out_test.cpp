// SPDX-License-Identifier: Apache-2.0
// Tests that rendering does not compile, allocate or launch kernels and buffers that only training needs.
#include <catch2/catch.hpp>

#include "host/base/error.hpp"
#include "host/opencl/core_groups.hpp"
#include "host/opencl/opencl_device.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

using Names = std::set<std::string>;

Names labels(const Device& device) {
  Names names;
  for (const auto& [label, bytes] : device.peak_by_label()) names.insert(label);
  return names;
}

Names without(const Names& all, const Names& some) {
  Names rest;
  for (const std::string& name : all)
    if (!some.contains(name)) rest.insert(name);
  return rest;
}

// Opens a separate device, so that kernels that other tests have built do not count.
std::unique_ptr<Device> fresh_device() { return open_device("opencl"); }
const opencl::OpenclDevice& opencl_of(const Device& device) {
  return dynamic_cast<const opencl::OpenclDevice&>(device);
}

void render(Device& device, const test::Data& data, RasterKind raster) {
  const auto stages = make_stages(device, {.dim = 6, .raster = raster, .backward = false});
  const SplatModel model = initialise_random(6, 300, 1);
  const DeviceModel on_device(device, model);
  Renderer renderer(device, *stages);
  renderer.set_cameras(cameras_of(data.train));
  renderer.forward(on_device.view(), 0, {}, false);
  CHECK_THROWS_WITH(renderer.forward(on_device.view(), 0, {}, true),
                    Catch::Contains("requires stages with a backward pass"));
  CHECK_THROWS_WITH(renderer.backward(BufferView<float>{}, false),
                    Catch::Contains("rendered with for_backward"));
}

TEST_CASE("rendering builds, allocates and launches nothing that only training needs", "[left_out][opencv]") {
  if (opencl_devices_under_test().empty()) return;  // the expected names are those of the OpenCL back end
  const test::Data data = test::synthetic("glossy", 32, 4);
  const auto drawing = fresh_device();
  render(*drawing, data, RasterKind::cpu);
  Names for_drawing{"parameters",  "cameras",        "projected splats",  "depth keys",    "tile rects",
                    "tile counts", "tile list sums", "tile list scratch", "sorted splats", "tile ranges",
                    "image",       "transmittance"};
  if (opencl::cores_for_groups(opencl_of(*drawing)) > 0) for_drawing.insert("claims of cores");
  CHECK(labels(*drawing) == for_drawing);
  CHECK(opencl_of(*drawing).created_kernels() ==
        Names{"project_forward", "count_sums", "count_write", "radix_histogram", "radix_scatter",
              "column_starts", "tile_histogram", "tile_scatter", "raster_cpu_forward"});
  // The programs that were built contain only two other kernels: column_scan, which replaces column_starts
  // for large histograms, and clamp_to_capacity, for lists whose length the host does not know. PoCL compiles
  // a kernel when it is launched for the first time, so these two take no time here.
  CHECK(opencl_of(*drawing).compiled_kernels() == Names{"project_forward", "count_sums", "count_write",
                                                        "radix_histogram", "radix_scatter", "column_starts",
                                                        "column_scan", "tile_histogram", "tile_scatter",
                                                        "raster_cpu_forward", "clamp_to_capacity"});

  const auto training = fresh_device();
  test::train(*training, test::short_run(6, 3, 300), data);  // with a refinement and an evaluation
  Names for_training{"parameter gradients", "first moments",  "second moments",
                     "learning rates",      "loss sums",      "loss maps",
                     "loss tile sums",      "metric sums",    "splat gradients",
                     "image gradient",      "slot offsets",   "sorted slots",
                     "block masks",         "gradient slots", "target image",
                     "mcmc weights",        "mcmc copies",    "mcmc sources",
                     "mcmc prefix",         "mcmc totals",    "sentinel"};
  CHECK(without(labels(*training), labels(*drawing)) == for_training);
  CHECK(without(opencl_of(*training).created_kernels(), opencl_of(*drawing).created_kernels()) ==
        Names{"raster_cpu_backward", "sum_slots_vector", "project_backward", "project_backward_adam",
              "adam_step_watched", "loss_margins", "loss_window", "loss_gradient", "loss_total", "regularise",
              "add_noise", "mcmc_weights", "mcmc_draw", "mcmc_sources", "mcmc_copies", "scan_write"});

  const auto groups = fresh_device();
  render(*groups, data, RasterKind::gpu);
  CHECK_FALSE(labels(*groups).contains("block masks"));
  CHECK_FALSE(labels(*groups).contains("list states"));
  CHECK_FALSE(labels(*groups).contains("sorted slots"));
  CHECK_FALSE(opencl_of(*groups).compiled_kernels().contains("raster_gpu_backward"));
}

TEST_CASE("stages without a backward pass render the same bits", "[left_out][opencv]") {
  const test::Data data = test::synthetic("glossy", 64, 4);
  const SplatModel model = initialise_random(6, 500, 1);
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device)) {
      std::vector<RenderedView> views;
      for (const bool backward : {false, true}) {
        const auto stages = make_stages(*device, {.dim = 6, .raster = raster, .backward = backward});
        const DeviceModel on_device(*device, model);
        Renderer renderer(*device, *stages);
        renderer.set_cameras(cameras_of(data.train));
        renderer.forward(on_device.view(), 1, {}, false);
        views.push_back(renderer.download());
      }
      CHECK(views[0].rgb == views[1].rgb);
      CHECK(views[0].alpha == views[1].alpha);
    }
}

}  // namespace
}  // namespace ubs
