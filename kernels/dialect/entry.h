// SPDX-License-Identifier: Apache-2.0
// entry.h defines the macros with which kernels in kernels/map declare their entry points and access memory. One
// work-item processes UBS_VW consecutive elements.
#pragma once

#ifdef UBS_OPENCL
#define UBS_KERNEL __kernel
#define UBS_GLOBAL __global
#define UBS_GLOBAL_ID(d) ((uint)get_global_id(d))
#define ubs_group_id() ((uint)get_group_id(0))
#define ubs_count(pointer) atomic_inc(pointer)
#define ubs_mul_hi64(a, b) mul_hi(a, b)
#else
#ifndef UBS_KERNEL  // programs compiled at run time define it with extern "C", so that kernels are found by name
#define UBS_KERNEL static __global__
#endif
#define UBS_GLOBAL
#define UBS_GLOBAL_ID(d) \
  ((d) == 0 ? blockIdx.x * blockDim.x + threadIdx.x : blockIdx.y * blockDim.y + threadIdx.y)
#define ubs_group_id() (blockIdx.x)
typedef unsigned int uint;
typedef unsigned short ushort;
typedef unsigned char uchar;
typedef unsigned long ulong;  // 64 bits on Linux; glibc has the same typedef
#define ubs_count(pointer) atomicAdd(pointer, 1u)
#define ubs_mul_hi64(a, b) __umul64hi(a, b)
#endif

#ifndef UBS_DEPTH  // 1: the rasterisers also write the expected depth
#define UBS_DEPTH 0
#endif

// The macros UBS_CORE_* allow the same kernel to run with or without core groups (opencl/core_groups.h). With core
// groups, each CPU core claims work-groups itself. The definitions below are those without core groups:
// - UBS_CORE_PARAMETERS: the additional parameters of the kernel. Without core groups there are none.
// - UBS_CORE_GROUP: the index of the work-group in a one-dimensional launch.
// - UBS_CORE_FIRST_ITEM: the index of the first item that the work-item processes.
// - UBS_CORE_ITEMS(item): the head of a loop over the items of the work-item. The block that processes one item follows
//   it. Without core groups it is empty, because a work-item processes only one item.
#ifndef UBS_CORES
#define UBS_CORE_PARAMETERS
#define UBS_CORE_GROUP ubs_group_id()
#define UBS_CORE_FIRST_ITEM UBS_GLOBAL_ID(0)
#define UBS_CORE_ITEMS(item)
#endif

// UBS_NOINLINE is the first statement of a large function that a kernel calls. It keeps the function from being inlined.
// PoCL compiles three copies of each kernel and inlines all called functions in each of them. It cannot inline a
// function that contains a computed jump, so there is only one copy of it, and compilation takes a third of the time.
#ifdef UBS_POCL
#define UBS_NOINLINE                               \
  {                                             \
    size_t address = (size_t)&&begin;           \
    __asm__("" : "+r"(address));                \
    goto*(__typeof__(&&begin))address;          \
  }                                             \
  begin:;
#else
#define UBS_NOINLINE
#endif

// The macros UBS_PREFETCH* prefetch a cache line on CPUs with PoCL. They are used for gathered values, and for
// parameters if there are more rows than the hardware prefetcher can follow. The function prefetch() of OpenCL has no
// effect on PoCL. UBS_PREFETCH_FAR loads into the second-level cache, which can load more lines at the same time than
// the first-level cache. It is used in loops that read from a hundred rows at once.
#ifdef UBS_POCL
#define UBS_PREFETCH(pointer) __builtin_prefetch((const void*)(size_t)(pointer))
#define UBS_PREFETCH_FAR(pointer) __builtin_prefetch((const void*)(size_t)(pointer), 0, 2)
#define UBS_PREFETCH_WRITE(pointer) __builtin_prefetch((const void*)(size_t)(pointer), 1)
#else
#define UBS_PREFETCH(pointer)
#define UBS_PREFETCH_FAR(pointer)
#define UBS_PREFETCH_WRITE(pointer)
#endif

// Returns first, first + 1, ... in the lanes.
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
#if UBS_VW == 16  // vstore16 is written out and not pasted together, because PoCL defines `vstore` as a macro
#define UBS_STORE(value, pointer) vstore16(value, 0, pointer)
#elif UBS_VW == 8
#define UBS_STORE(value, pointer) vstore8(value, 0, pointer)
#else
#define UBS_STORE(value, pointer) vstore4(value, 0, pointer)
#endif
#endif
