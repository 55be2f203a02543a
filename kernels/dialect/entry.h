// SPDX-License-Identifier: Apache-2.0
// Words for the entry points of map kernels: one work-item handles UBS_VW consecutive elements.
#pragma once

#ifdef UBS_OPENCL
#define UBS_KERNEL __kernel
#define UBS_GLOBAL __global
#define UBS_GLOBAL_ID(d) ((uint)get_global_id(d))
#define ubs_group_id() ((uint)get_group_id(0))
#define ubs_count(pointer) atomic_inc(pointer)
#define ubs_mul_hi64(a, b) mul_hi(a, b)
#else
#ifndef UBS_KERNEL  // compiled at run time: extern "C", to be found by name
#define UBS_KERNEL static __global__
#endif
#define UBS_GLOBAL
#define UBS_GLOBAL_ID(d) \
  ((d) == 0 ? blockIdx.x * blockDim.x + threadIdx.x : blockIdx.y * blockDim.y + threadIdx.y)
#define ubs_group_id() (blockIdx.x)
typedef unsigned int uint;
typedef unsigned short ushort;
typedef unsigned char uchar;
typedef unsigned long ulong;  // 64 bits on Linux, as glibc has it
#define ubs_count(pointer) atomicAdd(pointer, 1u)
#define ubs_mul_hi64(a, b) __umul64hi(a, b)
#endif

#ifndef UBS_DEPTH  // the rasterisers also write expected depth
#define UBS_DEPTH 0
#endif

// Where a core does not choose its groups (opencl/core_groups.h): the kernel's last parameters, of which
// there are none, its group in a launch along one dimension, its first work-item, and what stands before the block
// that all its items go through from the first on: nothing for one item.
#ifndef UBS_CORES
#define UBS_CORE_PARAMETERS
#define UBS_CORE_GROUP ubs_group_id()
#define UBS_CORE_FIRST_ITEM UBS_GLOBAL_ID(0)
#define UBS_CORE_ITEMS(item)
#endif

// First in a large function that a kernel calls. PoCL compiles three copies of each kernel, with all that it calls
// written out in each; what holds a computed jump it has to call. Compiling takes a third of the time.
#ifdef UBS_POCL
#define UBS_APART                               \
  {                                             \
    size_t address = (size_t)&&begin;           \
    __asm__("" : "+r"(address));                \
    goto*(__typeof__(&&begin))address;          \
  }                                             \
  begin:;
#else
#define UBS_APART
#endif

// Asks for a cache line ahead of its use, on CPUs: what is gathered, and more rows of parameters than the
// hardware follows by itself. OpenCL's own prefetch() does nothing on PoCL. FAR: into the second cache, which waits
// for more lines at a time than the first: where a hundred rows are walked along at once.
#ifdef UBS_POCL
#define UBS_PREFETCH(pointer) __builtin_prefetch((const void*)(size_t)(pointer))
#define UBS_PREFETCH_FAR(pointer) __builtin_prefetch((const void*)(size_t)(pointer), 0, 2)
#define UBS_PREFETCH_WRITE(pointer) __builtin_prefetch((const void*)(size_t)(pointer), 1)
#else
#define UBS_PREFETCH(pointer)
#define UBS_PREFETCH_FAR(pointer)
#define UBS_PREFETCH_WRITE(pointer)
#endif

// first, first + 1, ... by lane.
UBS_FN vuint ubs_lane_indices(uint first) {
#if defined(UBS_OPENCL) && UBS_VW == 16
  return first + (vuint)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#elif defined(UBS_OPENCL) && UBS_VW == 8
  return first + (vuint)(0, 1, 2, 3, 4, 5, 6, 7);
#elif defined(UBS_OPENCL) && UBS_VW == 4
  return first + (vuint)(0, 1, 2, 3);
#else
  return first;
#endif
}

#if UBS_VW == 1
#define UBS_LOAD(pointer) (*(pointer))
#define UBS_STORE(value, pointer) (*(pointer) = (value))
#else
#define UBS_LOAD(pointer) UBS_PASTE(vload, UBS_VW)(0, pointer)
#if UBS_VW == 16  // by name: PoCL's `vstore` is a macro itself
#define UBS_STORE(value, pointer) vstore16(value, 0, pointer)
#elif UBS_VW == 8
#define UBS_STORE(value, pointer) vstore8(value, 0, pointer)
#else
#define UBS_STORE(value, pointer) vstore4(value, 0, pointer)
#endif
#endif
