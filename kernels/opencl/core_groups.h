// SPDX-License-Identifier: Apache-2.0
// Assigns work-groups to the cores of a CPU. A core gets the same share of a kernel's work-groups in every launch. When
// it has finished its own share, it helps the other cores. Without this, PoCL gives a quarter to a half of the groups
// to the thread that asks first, so that data which one kernel writes and the next one uses move between the caches of
// the cores. This header is only used if UBS_CORES is defined; dialect/entry.h has the definitions for other kernels.
// `claims` contains a counter for each core, in a separate cache line. The counter is the number of groups that have
// already been taken from the share of the core, and must be zero before the launch. `next_claims` contains the
// counters of the next launch, which this launch sets to zero. A group consists of one OpenCL work-item, because PoCL
// would duplicate the code of the kernel after a barrier.
enum { kClaimStride = 16 };
#ifndef UBS_CORE_GROUP_ITEMS
#define UBS_CORE_GROUP_ITEMS 16  // number of items of a kernel that a group processes one after the other
#endif

// Returns the index of the share of the core that the caller runs on. UBS_CORE_SHARES lists this index for each core,
// starting with core 0. It is only defined if the numbers of the cores that the process may use have gaps.
#ifdef UBS_CORE_SHARES
__constant ushort kCoreShares[] = {UBS_CORE_SHARES};
#endif
static inline uint ubs_core(void) {
  uint core;
  __builtin_ia32_rdtscp(&core);
  core &= 0xfff;  // the upper bits are the number of the memory node
#ifdef UBS_CORE_SHARES
  if (core < sizeof(kCoreShares) / sizeof(ushort)) return kCoreShares[core];
#endif
  return core % UBS_CORES;
}

// Claims the next group for the caller and returns the index of this group.
static inline uint next_group(volatile __global uint* claims, volatile __global uint* next_claims) {
  const uint groups = (uint)get_num_groups(0), core = ubs_core();
  if (get_group_id(0) == 0)
    for (uint k = 0; k < UBS_CORES; ++k) next_claims[k * kClaimStride] = 0;
  for (uint k = 0;; ++k) {  // ends within one pass over the shares, because there are as many groups as callers
    const uint of = (core + k) % UBS_CORES;
    const uint begin = (uint)((ulong)groups * of / UBS_CORES);
    const uint share = (uint)((ulong)groups * (of + 1) / UBS_CORES) - begin;
    volatile __global uint* taken = claims + of * kClaimStride;
    if (*taken >= share) continue;  // without this read, atomic_inc would move the cache line to this core in vain
    const uint next = atomic_inc(taken);
    if (next < share) return begin + next;
  }
}

#define UBS_CORE_PARAMETERS , volatile __global uint *claims, volatile __global uint *next_claims
#define UBS_CORE_GROUP next_group(claims, next_claims)
#define UBS_CORE_FIRST_ITEM (UBS_CORE_GROUP * UBS_CORE_GROUP_ITEMS)
#define UBS_CORE_ITEMS(item) for (uint turn = 0; turn < UBS_CORE_GROUP_ITEMS; ++turn, ++item)
