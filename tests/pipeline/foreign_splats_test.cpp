// SPDX-License-Identifier: Apache-2.0
// Imported Gaussians on a device: a scene trained and rendered by another tool must look as it does there.
#include "host/data/blender.hpp"
#include "host/data/import_splats.hpp"
#include "host/data/splat_file.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
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

// The harmonics are evaluated for each camera here, which leaves nothing but kernel and covariances.
double mean_psnr(Device& device, const ImportedSplats& splats, ImportedModel imported, const Split& split) {
  const auto stages = make_stages(device, {.dim = 3, .raster = raster_kind("auto", device.info())});
  Renderer renderer(device, *stages);
  std::vector<Camera> cameras;
  for (const View& view : split.views) cameras.push_back(view.camera);
  renderer.set_cameras(cameras);
  RenderSettings settings;
  settings.projection.eps2d = static_cast<float>(imported.matching_eps2d());
  settings.background = {1, 1, 1};
  const ParameterLayout layout(3);
  double total = 0;
  for (std::size_t v = 0; v < split.views.size(); ++v) {
    const auto colours = colours_from(splats, cameras[v].centre());
    for (std::size_t i = 0; i < splats.count(); ++i)
      for (std::size_t c = 0; c < 3; ++c)
        imported.model.row(layout.rgb + static_cast<int>(c))[i] = colours[i][c];
    const DeviceModel model(device, imported.model);
    renderer.forward(model.view(), static_cast<std::uint32_t>(v), settings, false);
    total += psnr(renderer.download(), split.views[v].image) / static_cast<double>(split.views.size());
  }
  return total;
}

}  // namespace

TEST_CASE("foreign splats: lego of OpenSplat renders as OpenSplat renders it", "[foreign][data]") {
  const auto files = real_data("foreign_splats"), data = real_data("lego_200");
  if (files.empty() || data.empty()) return;
  const ImportedSplats splats = read_foreign_splats(files / "opensplat_lego_world.ply");
  BlenderOptions options;
  options.background = {1, 1, 1};
  const Split split = load_blender_split(data, "test", options);
  for (const auto& device : devices_under_test()) {
    const double exact =
        mean_psnr(*device, splats, import_splats(splats, {.dim = 3, .support = 3.08}), split);
    WARN(device->info().name << ": " << exact << " dB with harmonics (its own tool: 31.45 dB)");
    CHECK(exact > 30.3);  // the shape of the kernel costs the rest
    CHECK(exact < 32.5);
  }
}
