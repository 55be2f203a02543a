// SPDX-License-Identifier: Apache-2.0
// dialect.h defines the language of kernels/math and kernels/map. It is the common subset of OpenCL C 1.2, CUDA C++ and
// C++20, so that three compilers accept the same source. A value is a `vreal`, which has UBS_VW lanes in OpenCL and one
// lane otherwise. The rules of the dialect are:
// - Do not use references, templates, overloads, pointers or recursion; pass structs by value.
// - Do not branch on a `vreal`: select with `mask ? a : b`, and combine masks with & | !. In OpenCL both sides of ?:
//   must be vreal, so write literals as V(0.5) and scalars as R(0.5).
// - Write comparisons such that NaN gives the safe result. For example, !(det > 0) is true if det is NaN.
#pragma once

#if defined(__OPENCL_C_VERSION__) || defined(__OPENCL_VERSION__)
#define UBS_OPENCL 1
#endif

#if !defined(UBS_OPENCL) && !defined(__CUDACC__)
#define UBS_HOST 1
#ifndef UBS_REAL_DOUBLE
#define UBS_REAL_DOUBLE 1
#endif
#endif

#ifdef UBS_REAL_DOUBLE
#ifdef UBS_OPENCL
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#endif
typedef double real;
#ifndef UBS_HOST
typedef double4 real4;
#endif
#define R(x) x
#else
typedef float real;
#ifndef UBS_HOST
typedef float4 real4;
#endif
#define R(x) x##f
#endif

#ifndef UBS_VW
#define UBS_VW 1
#endif

#define UBS_PASTE2(a, b) a##b
#define UBS_PASTE(a, b) UBS_PASTE2(a, b)

#ifdef UBS_OPENCL
#ifdef UBS_POCL
// Without AVX-512, sixteen lanes are passed in two registers, and clang warns that this depends on the ABI. The warning
// only matters for libraries, but PoCL prints the number of warnings in the user's terminal. Other compilers that are
// based on clang must not see this pragma: NVIDIA's compiler does not know the option and warns about it.
#pragma clang diagnostic ignored "-Wpsabi"
#endif
// Functions are always inlined, even those with two callers, because a call passes structs of a hundred values through
// memory.
#define UBS_FN static inline __attribute__((always_inline))
#if defined(UBS_REAL_DOUBLE) && UBS_VW > 1
#error "double precision is compiled one lane wide"
#endif
#if UBS_VW == 1
typedef real vreal;
typedef int vmask;
typedef uint vuint;
#define UBS_TO_VREAL(x) ((real)(x))  // converts each lane
#define UBS_TO_VUINT(x) ((uint)(x))  // a float argument must be in the range of uint
#define UBS_FLOAT_BITS(x) as_uint((float)(x))
#else
typedef UBS_PASTE(float, UBS_VW) vreal;
typedef UBS_PASTE(int, UBS_VW) vmask;
typedef UBS_PASTE(uint, UBS_VW) vuint;
#define UBS_TO_VREAL UBS_PASTE(convert_float, UBS_VW)
#define UBS_TO_VUINT UBS_PASTE(convert_uint, UBS_VW)
#define UBS_FLOAT_BITS UBS_PASTE(as_uint, UBS_VW)
#endif
#define ubs_real_exp(x) exp(x)  // exponential of one scalar, for any UBS_VW
#define ubs_sqrt(x) sqrt(x)
#define ubs_fma(a, b, c) fma(a, b, c)
#define ubs_fabs(x) fabs(x)
// PoCL's own floor and ceil take a dozen instructions each.
#if defined(UBS_POCL) && __has_builtin(__builtin_elementwise_floor)
#define ubs_floor(x) __builtin_elementwise_floor(x)
#define ubs_ceil(x) __builtin_elementwise_ceil(x)
#else
#define ubs_floor(x) floor(x)
#define ubs_ceil(x) ceil(x)
#endif
#define ubs_sin(x) sin(x)
#define ubs_cos(x) cos(x)
#else  // CUDA, host
#include <math.h>
typedef real vreal;
typedef int vmask;
typedef unsigned int vuint;
#define UBS_TO_VREAL(x) ((real)(x))
#define UBS_TO_VUINT(x) ((vuint)(x))
#define UBS_FLOAT_BITS(x) __float_as_uint(x)
#ifdef UBS_HOST
#define UBS_FN [[maybe_unused]] static inline
#define ubs_exp(x) ::exp(x)
#define ubs_real_exp(x) ::exp(x)
#define ubs_sqrt(x) ::sqrt(x)
#define ubs_fma(a, b, c) ::fma(a, b, c)
#define ubs_fabs(x) ::fabs(x)
#define ubs_floor(x) ::floor(x)
#define ubs_ceil(x) ::ceil(x)
#define ubs_sin(x) ::sin(x)
#define ubs_cos(x) ::cos(x)
#else
#define UBS_FN static __device__ __forceinline__
#define ubs_exp(x) expf(x)
#define ubs_real_exp(x) expf(x)
#define ubs_sqrt(x) sqrtf(x)
#define ubs_fma(a, b, c) fmaf(a, b, c)
#define ubs_fabs(x) fabsf(x)
#define ubs_floor(x) floorf(x)
#define ubs_ceil(x) ceilf(x)
#define ubs_sin(x) sinf(x)
#define ubs_cos(x) cosf(x)
#endif
#endif

#define V(x) ((vreal)(R(x)))

// UBS_UNROLL must precede every loop of constant length over small arrays. When the loop is unrolled, the arrays become
// registers; otherwise they stay in memory, which makes PoCL's project_backward 3 times slower.
#ifdef UBS_HOST
#define UBS_UNROLL
#else
#define UBS_UNROLL _Pragma("unroll")
#endif

// ubs_any() returns whether a vmask is set in any lane. ubs_any_lane() does the same and is for inner loops: PoCL's
// any() tests the lanes one by one, which makes the rasteriser 2.5x slower.
#if defined(UBS_OPENCL) && UBS_VW > 1
#define ubs_any(mask) any(mask)
#ifdef UBS_POCL
#define ubs_any_lane(mask) (__builtin_reduce_or(mask) != 0)
#else
#define ubs_any_lane(mask) any(mask)
#endif
#else
#define ubs_any(mask) (mask)
#define ubs_any_lane(mask) (mask)
#endif

// Comparisons are used instead of fmin/fmax, so that both macros return NaN if the first argument is NaN.
#define ubs_min(a, b) ((a) > (b) ? (b) : (a))
#define ubs_max(a, b) ((a) < (b) ? (b) : (a))

#ifdef UBS_REAL_DOUBLE
#define UBS_REAL_MAX 1.7976931348623157e308
#else
#define UBS_REAL_MAX 3.402823466e+38f
#endif
// ubs_finite() is false for NaN and for both infinities.
#define ubs_finite(x) (ubs_fabs(x) <= (vreal)(UBS_REAL_MAX))
