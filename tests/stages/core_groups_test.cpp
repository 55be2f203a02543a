// SPDX-License-Identifier: Apache-2.0
// Tests kernels whose work-groups are assigned to CPU cores (CoreGroups): every work-item must run once per
// launch, for any number of work-groups, even if the kernel is compiled for more cores than the machine has.
#include "host/opencl/core_groups.hpp"

#include <array>
#include <catch2/catch.hpp>
#include <vector>

#include "tests/support/device_fixture.hpp"
#include "tests/support/kernel_folder.hpp"

namespace ubs {
namespace {

using namespace opencl;

TEST_CASE("work-groups that are assigned to cores run once per launch") {
  const test::KernelFolder folder;
  for (const auto& shared : opencl_devices_under_test()) {
    auto& device = dynamic_cast<OpenclDevice&>(*shared);
    if (cores_for_groups(device) == 0) {
      WARN("skipped: work-groups cannot be assigned to cores on " << describe(device.info()));
      continue;
    }
    // cores = 0 stands for two cores with the option UBS_CORE_SHARES, which assigns a share to each core.
    for (const std::uint32_t cores : {1u, 2u, 3u, 7u, 0u}) {
      CoreGroups core_groups(device, cores > 0 ? cores : 2);
      ProgramSpec spec = core_groups.program({{"../tests/support/core_groups_probe.cl"}, {}});
      if (cores == 0) spec.options.push_back("-DUBS_CORE_SHARES=" + core_shares(std::array{0u, 2u, 4u}, 2));
      Kernel kernel = device.kernel(spec, "core_groups_probe");
      for (const std::size_t groups : {1u, 2u, 5u, 64u, 1000u}) {
        INFO(groups << " groups for " << cores << " cores");
        Buffer<std::uint32_t> runs(device, "runs", kCoreGroupItems * groups);
        runs.zero();
        for (int launch = 0; launch < 3; ++launch) {
          core_groups.launch(kernel, groups, runs.view());
          // Without the argument, the launch fails, and must not disturb the next one.
          CHECK_THROWS_AS(core_groups.launch(kernel, groups), Error);
        }
        CHECK(runs.download() == std::vector<std::uint32_t>(runs.size(), 3));
      }
    }
  }
}

TEST_CASE("core_shares() returns a table if core numbers modulo the number of shares are not distinct") {
  CHECK(core_shares(std::array{0u, 1u, 2u, 3u}, 4) == "");
  CHECK(core_shares(std::array{6u, 7u, 8u, 9u}, 4) == "");
  CHECK(core_shares(std::array{1u, 4u}, 2) == "");
  CHECK(core_shares(std::array{0u, 2u, 4u, 6u}, 4) == "0,0,1,0,2,0,3");
  CHECK(core_shares(std::array{1u, 3u}, 2) == "0,0,0,1");
  CHECK(core_shares(std::array{0u, 2u, 4u}, 2) == "0,0,1,0,0");
  CHECK(core_shares(std::vector<std::uint32_t>{}, 2) == "");
}

}  // namespace
}  // namespace ubs
