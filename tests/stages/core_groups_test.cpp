// SPDX-License-Identifier: Apache-2.0
// Work-groups by core: whatever the number of groups and of cores, also of cores that there are not, every
// work-item is run once a launch.
#include "host/opencl/core_groups.hpp"

#include <catch2/catch.hpp>

#include "tests/support/device_fixture.hpp"
#include "tests/support/kernel_folder.hpp"

namespace ubs {
namespace {

using namespace opencl;

TEST_CASE("work-groups of cores are run once each") {
  const test::KernelFolder folder;
  for (const auto& shared : opencl_devices_under_test()) {
    auto& device = dynamic_cast<OpenclDevice&>(*shared);
    if (cores_for_groups(device) == 0) {
      WARN("skipped: no groups by core on " << describe(device.info()));
      continue;
    }
    for (const std::uint32_t cores : {1u, 2u, 3u, 7u}) {
      CoreGroups core_groups(device, cores);
      Kernel kernel = device.kernel(core_groups.program({{"../tests/support/core_groups_probe.cl"}, {}}),
                                    "core_groups_probe");
      for (const std::size_t groups : {1u, 2u, 5u, 64u, 1000u}) {
        INFO(groups << " groups for " << cores << " cores");
        Buffer<std::uint32_t> runs(device, "runs", kCoreGroupItems * groups);
        runs.zero();
        for (int launch = 0; launch < 3; ++launch) {
          core_groups.launch(kernel, groups, runs.view());
          CHECK_THROWS_AS(core_groups.launch(kernel, groups), Error);  // has not run, and changes nothing
        }
        CHECK(runs.download() == std::vector<std::uint32_t>(runs.size(), 3));
      }
    }
  }
}

}  // namespace
}  // namespace ubs
