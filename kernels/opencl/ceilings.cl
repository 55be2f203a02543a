// SPDX-License-Identifier: Apache-2.0
// What the device can do at most: multiply-adds on registers, and streams through memory or a cache. Work-item
// i handles the vectors first(i), first(i) + step, ...: chunks (CPUs) or interleaved (GPUs).

// Twelve chains hide the latency of an FMA (4 cycles, two a cycle) with room to spare.
#define UBS_CHAINS 12

__kernel void ceiling_fma(__global float* out, uint rounds, float factor) {
  vreal chain[UBS_CHAINS];
  vreal f = (vreal)(factor);
  UBS_UNROLL for (int i = 0; i < UBS_CHAINS; ++i) chain[i] = f + V(0.1) * (vreal)((float)i);
  for (uint r = 0; r < rounds; ++r)
    UBS_UNROLL for (int i = 0; i < UBS_CHAINS; ++i) chain[i] = fma(chain[i], f, V(1e-4));
  vreal sum = chain[0];
  UBS_UNROLL for (int i = 1; i < UBS_CHAINS; ++i) sum += chain[i];
  UBS_STORE(sum, out + get_global_id(0) * UBS_VW);
}

// Four streams a work-item, count / 4 vectors of each: cores prefetch several streams faster than one (PoCL,
// two cores: updates 70 GB/s with one stream, 120 with four).
__kernel void ceiling_read(__global const float* in, __global float* out, uint spacing, uint step, uint count,
                           uint rounds) {
  size_t quarter = (size_t)step * (count / 4) * UBS_VW;
  vreal a = V(0.0), b = V(0.0), c = V(0.0), d = V(0.0);
  for (uint r = 0; r < rounds; ++r) {
    __global const float* at = in + get_global_id(0) * (size_t)spacing * UBS_VW;
    for (uint k = 0; k < count / 4; ++k) {
      a += UBS_LOAD(at);
      b += UBS_LOAD(at + quarter);
      c += UBS_LOAD(at + 2 * quarter);
      d += UBS_LOAD(at + 3 * quarter);
      at += (size_t)step * UBS_VW;
    }
    a *= V(0.5);  // the next round depends on this one
  }
  UBS_STORE(a + b + c + d, out + get_global_id(0) * UBS_VW);
}

__kernel void ceiling_write(__global float* out, uint spacing, uint step, uint count, float value) {
  size_t quarter = (size_t)step * (count / 4) * UBS_VW;
  __global float* at = out + get_global_id(0) * (size_t)spacing * UBS_VW;
  for (uint k = 0; k < count / 4; ++k) {
    UBS_STORE((vreal)(value), at);
    UBS_STORE((vreal)(value), at + quarter);
    UBS_STORE((vreal)(value), at + 2 * quarter);
    UBS_STORE((vreal)(value), at + 3 * quarter);
    at += (size_t)step * UBS_VW;
  }
}

__kernel void ceiling_update(__global float* inout, uint spacing, uint step, uint count, float value,
                             uint rounds) {
  size_t quarter = (size_t)step * (count / 4) * UBS_VW;
  for (uint r = 0; r < rounds; ++r) {
    __global float* at = inout + get_global_id(0) * (size_t)spacing * UBS_VW;
    for (uint k = 0; k < count / 4; ++k) {
      UBS_STORE(UBS_LOAD(at) + (vreal)(value), at);
      UBS_STORE(UBS_LOAD(at + quarter) + (vreal)(value), at + quarter);
      UBS_STORE(UBS_LOAD(at + 2 * quarter) + (vreal)(value), at + 2 * quarter);
      UBS_STORE(UBS_LOAD(at + 3 * quarter) + (vreal)(value), at + 3 * quarter);
      at += (size_t)step * UBS_VW;
    }
  }
}
