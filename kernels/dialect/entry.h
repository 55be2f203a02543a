// SPDX-License-Identifier: Apache-2.0
// Words for the entry points of map kernels: one work-item handles UBS_VW consecutive elements.
#ifndef UBS_ENTRY_H
#define UBS_ENTRY_H

#ifdef UBS_OPENCL
#define UBS_KERNEL __kernel
#define UBS_GLOBAL __global
#define UBS_GLOBAL_ID(d) ((uint)get_global_id(d))
#define ubs_float_bits(x) as_uint(x)
#else
#define UBS_KERNEL static __global__
#define UBS_GLOBAL
#define UBS_GLOBAL_ID(d) \
  ((d) == 0 ? blockIdx.x * blockDim.x + threadIdx.x : blockIdx.y * blockDim.y + threadIdx.y)
typedef unsigned int uint;
typedef unsigned short ushort;
typedef unsigned char uchar;
typedef unsigned long ulong;  // 64 bits on Linux, as glibc has it
#define ubs_float_bits(x) __float_as_uint(x)
#endif

// Whether a vmask is set in any lane.
#if defined(UBS_OPENCL) && UBS_VW > 1
#define ubs_any(mask) any(mask)
#else
#define ubs_any(mask) (mask)
#endif

#if UBS_VW == 1
#define UBS_LOAD(pointer) (*(pointer))
#define UBS_STORE(value, pointer) (*(pointer) = (value))
#else
#define UBS_LOAD(pointer) UBS_PASTE(vload, UBS_VW)(0, pointer)
#define UBS_STORE(value, pointer) UBS_PASTE(vstore, UBS_VW)(value, 0, pointer)
#endif

#endif
