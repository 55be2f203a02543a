// SPDX-License-Identifier: Apache-2.0
// words.h defines macros for kernels whose work-items cooperate: work-groups, local memory and barriers. With them, the
// same source is compiled as OpenCL C and as CUDA C++. In CUDA a work-group is a block, a work-item a thread, and a
// wave a warp of 32.
// - UBS_GROUP(n) follows UBS_KERNEL. The kernel runs in work-groups of n work-items.
// - UBS_SHARED declares a variable in local memory. It may only be used in kernels. UBS_LOCAL is the address space of a
//   pointer to such a variable.
// - UBS_BARRIER() waits for all work-items of the group and for their writes to local memory.
// - ubs_local_id() is the index of the work-item in its group, ubs_group_at(d) the index of the group in dimension d of
//   the launch, and ubs_groups_across() the number of groups in dimension 0.
// - ubs_atomic_or(pointer, bits) and ubs_atomic_max(pointer, value) change a word in local memory atomically.
// exchange.h contains the functions with which the lanes of a wave exchange values.
#pragma once

#ifdef UBS_OPENCL
#define UBS_GROUP(n) __attribute__((reqd_work_group_size(n, 1, 1)))
#define UBS_SHARED __local
#define UBS_LOCAL __local
#define UBS_CONSTANT __constant
#define UBS_BARRIER() barrier(CLK_LOCAL_MEM_FENCE)
#define ubs_local_id() ((int)get_local_id(0))
#define ubs_group_at(d) get_group_id(d)
#define ubs_groups_across() get_num_groups(0)
#define ubs_atomic_or(pointer, bits) atomic_or(pointer, bits)
#define ubs_atomic_max(pointer, value) atomic_max(pointer, value)
#define ubs_popcount(bits) ((int)popcount(bits))
#define ubs_as_uint(value) as_uint(value)
#define ubs_as_float(bits) as_float(bits)
#define ubs_float4(x, y, z, w) ((float4)(x, y, z, w))
#else
#define UBS_GROUP(n) __launch_bounds__(n)
#define UBS_SHARED __shared__
#define UBS_LOCAL
#define UBS_CONSTANT static __constant__ const
#define UBS_BARRIER() __syncthreads()
#define ubs_local_id() ((int)threadIdx.x)
#define ubs_group_at(d) ((d) == 0 ? blockIdx.x : (d) == 1 ? blockIdx.y : blockIdx.z)
#define ubs_groups_across() (gridDim.x)
#define ubs_atomic_or(pointer, bits) atomicOr(pointer, bits)
#define ubs_atomic_max(pointer, value) atomicMax(pointer, value)
#define ubs_popcount(bits) __popc(bits)
#define ubs_as_uint(value) __float_as_uint(value)
#define ubs_as_float(bits) __uint_as_float(bits)
#define ubs_float4(x, y, z, w) make_float4(x, y, z, w)
UBS_FN int lowest_bit32(uint bits) { return __ffs((int)bits) - 1; }  // bits must not be 0
#endif
