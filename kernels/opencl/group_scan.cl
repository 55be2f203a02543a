// SPDX-License-Identifier: Apache-2.0
// The functions of this file compute sums over the 256 work-items of a work-group through local memory. Sub-groups are
// not used, because their width is unknown and PoCL does not have them. UBS_SUM is the type of the sum, an unsigned
// integer type. On overflow, the sum wraps.
#pragma once

enum { kGroup = 256 };

// kScanRoom is the number of elements of local memory that a sum needs. Rows of 16 values are stored with a pitch of
// 17, so that they start in different banks. The sums of the rows follow.
enum {
  kScanRow = 16,
  kScanRows = kGroup / kScanRow,
  kScanRoom = kGroup + 2 * kScanRows,
};

// Functions with barriers must be inlined, as all functions with UBS_FN are. Otherwise PoCL 3.1 compiles a function
// with two callers as a call, and its barriers have no effect. (In a test, a block sort returned its input unchanged.)

// Returns the sum of the values of all work-items before this one, and sets *total to the sum over all work-items.
// Every work-item of the group must call this function. `scratch` has kScanRoom elements, and may be used again after
// the function has returned.
UBS_FN UBS_SUM group_exclusive(UBS_SUM value, __local UBS_SUM* scratch, UBS_SUM* total) {
  const uint me = (uint)get_local_id(0), row = me / kScanRow;
  __local UBS_SUM* rows = scratch + kGroup + kScanRows;
  scratch[me + row] = value;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (me < kScanRows) {
    UBS_SUM running = 0;
    for (uint k = 0; k < kScanRow; k++) {
      const UBS_SUM next = scratch[me * (kScanRow + 1) + k];
      scratch[me * (kScanRow + 1) + k] = running;
      running += next;
    }
    rows[me] = running;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  UBS_SUM before = scratch[me + row], all = 0;
  for (uint k = 0; k < kScanRows; k++) {
    const UBS_SUM of_row = rows[k];
    if (k < row) before += of_row;
    all += of_row;
  }
  *total = all;
  barrier(CLK_LOCAL_MEM_FENCE);
  return before;
}

// Returns sums[0] + ... + sums[count - 1] in all work-items.
UBS_FN UBS_SUM sum_before(__global const UBS_SUM* sums, uint count, __local UBS_SUM* scratch) {
  UBS_SUM mine = 0, total;
  for (uint k = (uint)get_local_id(0); k < count; k += kGroup) mine += sums[k];
  group_exclusive(mine, scratch, &total);
  return total;
}
