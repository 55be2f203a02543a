// SPDX-License-Identifier: Apache-2.0
// This file replaces kernels/gpu/exchange.h in tests on devices whose work-items cannot read each other's
// values. It treats the work-group as one wave, and passes values between lanes through local memory. All
// work-items of the work-group must call these functions, as all lanes of a wave must on NVIDIA devices.

__attribute__((always_inline)) static inline float emulated_xor(__local float* handed, float mine, int distance) {
  int item = (int)get_local_id(0);
  handed[item] = mine;
  barrier(CLK_LOCAL_MEM_FENCE);
  float other = handed[item ^ distance];
  barrier(CLK_LOCAL_MEM_FENCE);
  return other;
}

__attribute__((always_inline)) static inline int emulated_any(__local float* handed, int mine) {
  handed[get_local_id(0)] = mine ? 1.0f : 0.0f;
  barrier(CLK_LOCAL_MEM_FENCE);
  float any = 0.0f;
  for (int i = 0; i < (kTileSide * kTileSide); ++i) any = fmax(any, handed[i]);
  barrier(CLK_LOCAL_MEM_FENCE);
  return any > 0.0f;
}

#define UBS_EXCHANGE_LOCALS __local float handed[(kTileSide * kTileSide)];
#define UBS_EXCHANGE_PARAMETER , __local float *handed
#define UBS_EXCHANGE_ARGUMENT , handed
#define UBS_WAVES
#define UBS_BALLOT 0
#define ubs_item() ((int)get_local_id(0))
#define lane_xor8(x) emulated_xor(handed, x, 8)
#define lane_xor4(x) emulated_xor(handed, x, 4)
#define lane_xor2(x) emulated_xor(handed, x, 2)
#define lane_xor1(x) emulated_xor(handed, x, 1)
#define any_of_wave(condition) emulated_any(handed, condition)
