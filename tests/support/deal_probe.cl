// SPDX-License-Identifier: Apache-2.0
// Counts how often each work-item of a dealt launch is run (behind opencl/deal.h, by tests/stages/deal_test.cpp).
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void deal_probe(
    volatile __global uint* runs UBS_DEALT_PARAMETERS) {
  UBS_DEALT_ITEMS(item) atomic_inc(runs + item);
}
