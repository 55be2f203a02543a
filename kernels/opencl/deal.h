// SPDX-License-Identifier: Apache-2.0
// Work-groups by core, for CPUs: the same core gets the same share of a kernel's groups at every launch, and takes
// over from the others when it has done its own. Left to itself PoCL gives the first half of the groups to the thread
// that asks first, so that parameters and moments wander between the caches of the cores.
// claims (zero before and after a launch): groups taken of the share of each core and, last, of all; UBS_CORES + 1
// counters, each in a cache line of its own. A group is one work-item of OpenCL, which takes UBS_DEAL_GROUP of the kernel's
// in a loop: behind a barrier PoCL would write the kernel out twice.
#define UBS_CLAIM_STRIDE 16
#define UBS_DEAL_GROUP 16

static inline uint ubs_core(void) {
  uint core;
  __builtin_ia32_rdtscp(&core);
  return (core & 0xfff) % UBS_CORES;  // above: the memory node
}

// The group that the caller is to be.
static inline uint claim_group(__global uint* claims) {
  const uint groups = (uint)get_num_groups(0), core = ubs_core();
  uint group = groups;
  for (uint k = 0; k < UBS_CORES && group == groups; ++k) {
    const uint of = (core + k) % UBS_CORES;
    const uint begin = groups * of / UBS_CORES, share = groups * (of + 1) / UBS_CORES - begin;
    volatile __global uint* taken = claims + of * UBS_CLAIM_STRIDE;
    if (*taken >= share) continue;  // so that looking for what is left takes no line from its core
    const uint next = atomic_inc(taken);
    if (next < share) group = begin + next;
  }
  // There are as many groups as callers, so one was found. Who takes the last one leaves zeros.
  if (atomic_inc(claims + UBS_CORES * UBS_CLAIM_STRIDE) + 1 == groups)
    for (uint k = 0; k <= UBS_CORES; ++k) claims[k * UBS_CLAIM_STRIDE] = 0;
  return group;
}

#define UBS_DEALT_PARAMETER , __global uint* claims
#define UBS_DEALT_ITEMS(item)                                                                            \
  for (uint item = claim_group(claims) * UBS_DEAL_GROUP, end_of_items = item + UBS_DEAL_GROUP; item < end_of_items; \
       ++item)
