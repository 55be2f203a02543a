// SPDX-License-Identifier: Apache-2.0
// Helpers of group kernels: sums over the 256 work-items of a group through local memory. No sub-groups:
// their width is unknown, and PoCL has none. UBS_SUM is the type of the sum (wraps like any unsigned type).
#ifndef UBS_GROUP_SCAN_CL
#define UBS_GROUP_SCAN_CL

#define UBS_GROUP 256
#ifndef UBS_SUM
#define UBS_SUM uint
#endif

// Functions with barriers must be inlined by force: PoCL 3.1 leaves one that is called twice as a call, whose
// barriers then do nothing (measured: a block sort that returned its input).
#define UBS_GROUP_FN __attribute__((always_inline)) static inline

// Sum of the values of all work-items before this one; *total: of all. Every work-item must call it,
// and `scratch` (UBS_GROUP elements) is free again when it returns.
UBS_GROUP_FN UBS_SUM group_exclusive(UBS_SUM value, __local UBS_SUM* scratch, UBS_SUM* total) {
  const uint me = (uint)get_local_id(0);
  scratch[me] = value;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint step = 1; step < UBS_GROUP; step <<= 1) {
    const UBS_SUM before = me >= step ? scratch[me - step] : 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    scratch[me] += before;
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  *total = scratch[UBS_GROUP - 1];
  const UBS_SUM before_me = scratch[me] - value;
  barrier(CLK_LOCAL_MEM_FENCE);
  return before_me;
}

#endif
