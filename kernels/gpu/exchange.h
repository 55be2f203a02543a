// SPDX-License-Identifier: Apache-2.0
// With exchange.h, the lanes of a block of 16 work-items exchange values without storing them in memory. UBS_SUBGROUPS
// selects the mechanism (host/opencl/exchange.hpp): 0: none; 1: cl_khr_subgroup_shuffle; 2: NVIDIA's shfl (always used
// in CUDA); 3: DPP and ds_swizzle of AMD. The functions and macros are:
// - ubs_item(): returns the number of the work-item in its group, in an order in which 16 consecutive work-items are
//   lanes of the same wave.
// - lane_xor8(x), lane_xor4(x), lane_xor2(x), lane_xor1(x): return the x of the lane whose number is that of this lane
//   xor 8, 4, 2 or 1. Both lanes must take the same branch.
// - any_of_wave(condition): returns whether a loop with exchanges must continue. With mechanisms in which all lanes of
//   a wave must take part in an exchange, it is true if the condition holds in any lane of the wave. With the other
//   mechanisms, it is the condition of the lane itself.
// - UBS_BALLOT: 1 if waves consist of 32 work-items with consecutive local ids. In this case ballot(condition) returns
//   a word with one bit for each work-item of the wave. If UBS_BALLOT is 0, the size of waves is unknown, except that
//   it is a multiple of 16.
#ifndef UBS_OPENCL
#define UBS_SUBGROUPS 2
#endif
#ifndef UBS_SUBGROUPS
#define UBS_SUBGROUPS 0
#endif
#define UBS_BALLOT (UBS_SUBGROUPS == 2)

#ifndef UBS_OPENCL
#define lane_xor8(x) __shfl_xor_sync(0xffffffffu, x, 8)
#define lane_xor4(x) __shfl_xor_sync(0xffffffffu, x, 4)
#define lane_xor2(x) __shfl_xor_sync(0xffffffffu, x, 2)
#define lane_xor1(x) __shfl_xor_sync(0xffffffffu, x, 1)
#define any_of_wave(condition) __any_sync(0xffffffffu, condition)
#define ballot(condition) __ballot_sync(0xffffffffu, condition)

#elif UBS_SUBGROUPS == 1
#ifdef cl_khr_subgroups
#pragma OPENCL EXTENSION cl_khr_subgroups : enable
#endif
#ifdef cl_intel_required_subgroup_size  // without this attribute, a compiler may choose sub-groups of 8 lanes
#define UBS_WAVES __attribute__((intel_reqd_sub_group_size(16)))
#endif
// The work-item's number is computed from its sub-group, because the driver decides which work-items form a sub-group.
UBS_FN int ubs_item(void) {
  return (int)(get_sub_group_id() * get_max_sub_group_size() + get_sub_group_local_id());
}
#define lane_xor8(x) sub_group_shuffle_xor(x, 8)
#define lane_xor4(x) sub_group_shuffle_xor(x, 4)
#define lane_xor2(x) sub_group_shuffle_xor(x, 2)
#define lane_xor1(x) sub_group_shuffle_xor(x, 1)
#define any_of_wave(condition) (condition)

#elif UBS_SUBGROUPS == 2
#define UBS_DEFINE_XOR(distance)                                                                              \
  UBS_FN float lane_xor##distance(float x) {                                                                  \
    float y;                                                                                                  \
    __asm__ volatile("shfl.sync.bfly.b32 %0, %1, " #distance ", 0x1f, 0xffffffff;" : "=f"(y) : "f"(x));       \
    return y;                                                                                                 \
  }
UBS_DEFINE_XOR(8)
UBS_DEFINE_XOR(4)
UBS_DEFINE_XOR(2)
UBS_DEFINE_XOR(1)
UBS_FN int any_of_wave(int condition) {
  int any;
  __asm__ volatile(
      "{ .reg .pred p; setp.ne.s32 p, %1, 0; vote.sync.any.pred p, p, 0xffffffff; selp.s32 %0, 1, 0, p; }"
      : "=r"(any)
      : "r"(condition));
  return any;
}
UBS_FN uint ballot(int condition) {
  uint lanes;
  __asm__ volatile("{ .reg .pred p; setp.ne.s32 p, %1, 0; vote.sync.ballot.b32 %0, p, 0xffffffff; }"
                   : "=r"(lanes)
                   : "r"(condition));
  return lanes;
}

#elif UBS_SUBGROUPS == 3
// The exchanges stay within rows of 16 lanes: a rotation by 8, and permutations within groups of four. Only newer GPUs
// have an instruction for lanes at a distance of 4; therefore that exchange uses the crossbar of local memory.
#define UBS_AMD_DPP(x, control) as_float(__builtin_amdgcn_mov_dpp(as_int(x), control, 0xf, 0xf, true))
#define lane_xor8(x) UBS_AMD_DPP(x, 0x128)
#define lane_xor4(x) as_float(__builtin_amdgcn_ds_swizzle(as_int(x), 0x101f))
#define lane_xor2(x) UBS_AMD_DPP(x, 0x4e)
#define lane_xor1(x) UBS_AMD_DPP(x, 0xb1)
#define any_of_wave(condition) (condition)
#endif

#if UBS_SUBGROUPS != 1
UBS_FN int ubs_item(void) { return ubs_local_id(); }
#endif
#ifndef UBS_WAVES
#define UBS_WAVES
#endif
#ifndef UBS_EXCHANGE_LOCALS  // tests define these macros, so that lanes exchange values through local memory
#define UBS_EXCHANGE_LOCALS
#define UBS_EXCHANGE_PARAMETER
#define UBS_EXCHANGE_ARGUMENT
#endif
