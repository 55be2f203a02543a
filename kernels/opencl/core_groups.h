// SPDX-License-Identifier: Apache-2.0
// Work-groups by core, for CPUs: the same core gets the same share of a kernel's groups at every launch, and
// takes over from the others when it has done its own. Left to itself PoCL gives the first half of the groups
// to the thread that asks first, so that what one kernel writes and the next one reads or writes again
// wanders between the caches of the cores. With UBS_CORES only; what kernels have otherwise is in
// dialect/entry.h. claims: groups taken of the share of each core, each in a cache line of its own; zero
// before the launch. next_claims: those of the launch after, which this one sets to zero. A group is one
// work-item of OpenCL: behind a barrier PoCL would write the kernel out twice.
enum { kClaimStride = 16 };
#ifndef UBS_CORE_GROUP_ITEMS
#define UBS_CORE_GROUP_ITEMS 16  // work-items of a kernel that a group takes one after the other
#endif

// The share of the core that the caller runs on. UBS_CORE_SHARES: those of the cores from 0 on, where the process may use
// cores whose numbers have gaps.
#ifdef UBS_CORE_SHARES
__constant ushort kCoreShares[] = {UBS_CORE_SHARES};
#endif
static inline uint ubs_core(void) {
  uint core;
  __builtin_ia32_rdtscp(&core);
  core &= 0xfff;  // above: the memory node
#ifdef UBS_CORE_SHARES
  if (core < sizeof(kCoreShares) / sizeof(ushort)) return kCoreShares[core];
#endif
  return core % UBS_CORES;
}

// The group that the caller is to be.
static inline uint claim_group(volatile __global uint* claims, volatile __global uint* next_claims) {
  const uint groups = (uint)get_num_groups(0), core = ubs_core();
  if (get_group_id(0) == 0)
    for (uint k = 0; k < UBS_CORES; ++k) next_claims[k * kClaimStride] = 0;
  for (uint k = 0;; ++k) {  // as many groups as callers: one is found at the first turn through the shares
    const uint of = (core + k) % UBS_CORES;
    const uint begin = (uint)((ulong)groups * of / UBS_CORES);
    const uint share = (uint)((ulong)groups * (of + 1) / UBS_CORES) - begin;
    volatile __global uint* taken = claims + of * kClaimStride;
    if (*taken >= share) continue;  // so that looking for what is left takes no line from its core
    const uint next = atomic_inc(taken);
    if (next < share) return begin + next;
  }
}

#define UBS_CORE_PARAMETERS , volatile __global uint *claims, volatile __global uint *next_claims
#define UBS_CORE_GROUP claim_group(claims, next_claims)
#define UBS_CORE_FIRST_ITEM (UBS_CORE_GROUP * UBS_CORE_GROUP_ITEMS)
#define UBS_CORE_ITEMS(item) for (uint turn = 0; turn < UBS_CORE_GROUP_ITEMS; ++turn, ++item)
