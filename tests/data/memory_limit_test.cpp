// SPDX-License-Identifier: Apache-2.0
// Tests how the memory limits of control groups are read.
#include "host/base/memory_limit.hpp"

#include <limits>

#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();

TEST_CASE("memory limit: the smallest limit of a control group and its parents is used", "[file]") {
  const test::TempFolder root;
  const auto limit = [&] { return memory_limit(root.path()); };
  CHECK(limit() == kNone);
  test::put(root / "proc/self/cgroup", "0::/a/b\n");
  CHECK(limit() == kNone);
  test::put(root / "sys/fs/cgroup/a/b/memory.max", "max\n");
  CHECK(limit() == kNone);
  test::put(root / "sys/fs/cgroup/a/memory.max", "4000000000\n");
  CHECK(limit() == 4000000000u);
  test::put(root / "sys/fs/cgroup/a/b/memory.max", "5000\n");
  CHECK(limit() == 5000);
  test::put(root / "sys/fs/cgroup/memory.max", "70\n");  // the root group, which has a limit in containers
  CHECK(limit() == 70);
}

TEST_CASE("memory limit: control groups of version 1 are supported", "[file]") {
  const test::TempFolder root;
  test::put(root / "proc/self/cgroup", "9:name=systemd:/x\n4:cpu,memory:/job/1\n1:cpuset:/y\n0::/\n");
  test::put(root / "sys/fs/cgroup/memory/job/1/memory.limit_in_bytes", "9223372036854771712\n");
  test::put(root / "sys/fs/cgroup/memory/memory.limit_in_bytes", "300\n");
  CHECK(memory_limit(root.path()) == 300);
}

}  // namespace
}  // namespace ubs
