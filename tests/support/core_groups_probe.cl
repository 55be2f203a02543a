// SPDX-License-Identifier: Apache-2.0
// This kernel counts how often each work-item of a launch with opencl/core_groups.h is run.
// tests/stages/core_groups_test.cpp launches it.
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void core_groups_probe(
    volatile __global uint* runs UBS_CORE_PARAMETERS) {
  uint item = UBS_CORE_FIRST_ITEM;
  UBS_CORE_ITEMS(item) atomic_inc(runs + item);
}
