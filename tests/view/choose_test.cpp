// SPDX-License-Identifier: Apache-2.0
// Tests DeviceGroups::upload(): if some splats of a model are selected and uploaded into the existing
// buffers, the image must be the same as that of new buffers with only these splats.
#include <catch2/catch.hpp>

#include "host/lab/oracle/scenes.hpp"
#include "host/model/decompose.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/train/run_settings.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;

namespace {

std::vector<float> drawn(Device& device, const DeviceGroups& groups) {
  Renderer renderer(device, groups.stages());
  renderer.set_cameras({oracle::ring_camera({.dim = 6}, 0)});
  renderer.forward(groups.view(), 0, render_settings({}), false);
  return renderer.download().rgb;
}

}  // namespace

TEST_CASE("a selection of splats that is uploaded gives the same image as a separate model") {
  const auto scene = [](int dim) {
    return oracle::regular_scene({.count = 300, .dim = dim, .seed = 5}).model;
  };
  const MixedModel model({scene(6), scene(3)});
  // Splats with N = 3 have no angular betas. Their quantiles are the lowest, so the range from 0.6 contains
  // none of them.
  const MixedModel some =
      keep_splats(model, select_by_quantile(beta_quantiles(model, BetaKind::spatial), {0.3, 0.6}));
  const MixedModel one_group =
      keep_splats(model, select_by_quantile(beta_quantiles(model, BetaKind::angular), {0.6, 1}));
  const MixedModel none = keep_splats(model, std::vector<bool>(model.count(), false));
  REQUIRE(some.groups.size() == 2);
  REQUIRE(one_group.groups.size() == 1);
  for (const auto& device : devices_under_test()) {
    KernelConfig config = kernel_config(6, {}, {}, device->info());
    config.backward = false;
    DeviceGroups groups(*device, model, config);
    const std::vector<float> all = drawn(*device, groups);
    for (const MixedModel* part : {&some, &one_group, &none}) {
      groups.upload(*part);
      const std::vector<float> picture = drawn(*device, groups);
      CHECK(picture == drawn(*device, DeviceGroups(*device, *part, config)));
      CHECK(picture != all);
      groups.upload(model);
      CHECK(drawn(*device, groups) == all);
    }
    CHECK(test::message_of([&] { groups.upload(MixedModel(scene(7))); }, ErrorKind::internal).find("N = 7") !=
          std::string::npos);
  }
}
