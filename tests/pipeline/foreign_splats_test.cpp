// SPDX-License-Identifier: Apache-2.0
// Tests imported Gaussians on a device: for a scene that OpenSplat trained, the PSNR of renders of ubs must
// differ by less than 0.1 dB from the PSNR that OpenSplat reports for its own renders.
#include "host/dataset/blender.hpp"
#include "host/formats/splat_file.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "tests/support/data.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;

namespace {

double psnr(const RenderedView& view, const Image8& image) {
  double sum = 0;
  for (std::size_t i = 0; i < image.rgb.size(); ++i) {
    const double d = std::clamp(view.rgb[i], 0.0f, 1.0f) - image.rgb[i] / 255.0;
    sum += d * d;
  }
  return -10 * std::log10(sum / static_cast<double>(image.rgb.size()));
}

double mean_psnr(Device& device, const LoadedModel& loaded, const Split& split) {
  const SplatModel& splats = loaded.model.groups.front();
  const auto stages = make_stages(
      device, {.dim = 3, .raster = raster_kind("auto", device.info()), .variant = splats.variant});
  Renderer renderer(device, *stages);
  renderer.set_cameras(cameras_of(split));
  RenderSettings settings;
  settings.projection.eps2d = 0.3f;
  settings.background = {1, 1, 1};
  const DeviceModel model(device, splats);
  double total = 0;
  for (std::size_t v = 0; v < split.views.size(); ++v) {
    renderer.forward(model.view(), static_cast<std::uint32_t>(v), settings, false);
    total += psnr(renderer.download(), split.views[v].image) / static_cast<double>(split.views.size());
  }
  return total;
}

}  // namespace

TEST_CASE("foreign splats: ubs and OpenSplat render a lego scene with the same PSNR", "[foreign][data]") {
  UBS_REQUIRE_DATA(files, "foreign_splats");
  UBS_REQUIRE_DATA(data, "lego_200");
  const auto file = files / "opensplat_lego_world.ply";
  DatasetOptions options;
  options.background = {1, 1, 1};
  const Split split = load_blender_split(data, "test", options);
  for (const auto& device : devices_under_test()) {
    const double exact = mean_psnr(*device, load_splat_model(file), split);
    // OpenSplat reports 31.45 dB for the 200 test views of the scene. The data contain 25 of them.
    WARN(device->info().name << ": " << exact << " dB (rendered by OpenSplat: 31.45 dB)");
    CHECK(std::abs(exact - 31.45) < 0.1);
  }
}
