// SPDX-License-Identifier: Apache-2.0
// Sub-group functions for devices without them (OpenCL C, put in front of raster_gpu.cl by a test): every
// UBS_EMULATED_WIDTH consecutive work-items are a sub-group, reductions pass through local memory. They contain
// barriers, so all sub-groups of a work-group must call them equally often, as they do with equal widths.

static inline float emulated_reduce(__local float* all, float mine, int what) {
  int item = (int)get_local_id(0), first = item / UBS_EMULATED_WIDTH * UBS_EMULATED_WIDTH;
  all[item] = mine;
  barrier(CLK_LOCAL_MEM_FENCE);
  float result = all[first];
  for (int i = 1; i < UBS_EMULATED_WIDTH; ++i) {
    float other = all[first + i];
    result = what == 0 ? result + other : what < 0 ? fmin(result, other) : fmax(result, other);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  return result;
}

#define UBS_SUBGROUP_LOCALS __local float emulated[UBS_ITEMS];
#define UBS_SUBGROUP_PARAMETER , __local float *emulated
#define UBS_SUBGROUP_ARGUMENT , emulated
#define sub_group_reduce_add(x) emulated_reduce(emulated, x, 0)
#define sub_group_reduce_min(x) (int)emulated_reduce(emulated, (float)(x), -1)
#define sub_group_reduce_max(x) (int)emulated_reduce(emulated, (float)(x), 1)
