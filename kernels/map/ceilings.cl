// SPDX-License-Identifier: Apache-2.0
// What the device can do at most: multiply-adds on registers, and streams through memory or a cache. Work-item
// i handles the vectors first(i), first(i) + step, ...: chunks (CPUs) or interleaved (GPUs).

// Twelve chains hide the latency of an FMA (4 cycles, two a cycle) with room to spare.
enum { kChains = 12 };

UBS_KERNEL void ceiling_fma(UBS_GLOBAL float* out, uint rounds, float factor) {
  vreal chain[kChains];
  vreal f = (vreal)(factor);
  UBS_UNROLL for (int i = 0; i < kChains; ++i) chain[i] = f + V(0.1) * (vreal)((float)i);
  for (uint r = 0; r < rounds; ++r)
    UBS_UNROLL for (int i = 0; i < kChains; ++i) chain[i] = fma(chain[i], f, V(1e-4));
  vreal sum = chain[0];
  UBS_UNROLL for (int i = 1; i < kChains; ++i) sum += chain[i];
  UBS_STORE(sum, out + (size_t)UBS_GLOBAL_ID(0) * UBS_VW);
}

// Four streams a work-item, count / 4 vectors of each: cores prefetch several streams faster than one (PoCL,
// two cores: updates 70 GB/s with one stream, 120 with four).
UBS_KERNEL void ceiling_read(UBS_GLOBAL const float* in, UBS_GLOBAL float* out, uint spacing, uint step, uint count,
                           uint rounds) {
  size_t quarter = (size_t)step * (count / 4) * UBS_VW;
  vreal a = V(0.0), b = V(0.0), c = V(0.0), d = V(0.0);
  for (uint r = 0; r < rounds; ++r) {
    UBS_GLOBAL const float* at = in + UBS_GLOBAL_ID(0) * (size_t)spacing * UBS_VW;
    for (uint k = 0; k < count / 4; ++k) {
      a += UBS_LOAD(at);
      b += UBS_LOAD(at + quarter);
      c += UBS_LOAD(at + 2 * quarter);
      d += UBS_LOAD(at + 3 * quarter);
      at += (size_t)step * UBS_VW;
    }
    a *= V(0.5);  // the next round depends on this one
  }
  UBS_STORE(a + b + c + d, out + (size_t)UBS_GLOBAL_ID(0) * UBS_VW);
}

UBS_KERNEL void ceiling_write(UBS_GLOBAL float* out, uint spacing, uint step, uint count, float value) {
  size_t quarter = (size_t)step * (count / 4) * UBS_VW;
  UBS_GLOBAL float* at = out + UBS_GLOBAL_ID(0) * (size_t)spacing * UBS_VW;
  for (uint k = 0; k < count / 4; ++k) {
    UBS_STORE((vreal)(value), at);
    UBS_STORE((vreal)(value), at + quarter);
    UBS_STORE((vreal)(value), at + 2 * quarter);
    UBS_STORE((vreal)(value), at + 3 * quarter);
    at += (size_t)step * UBS_VW;
  }
}

UBS_KERNEL void ceiling_update(UBS_GLOBAL float* inout, uint spacing, uint step, uint count, float value,
                             uint rounds) {
  size_t quarter = (size_t)step * (count / 4) * UBS_VW;
  for (uint r = 0; r < rounds; ++r) {
    UBS_GLOBAL float* at = inout + UBS_GLOBAL_ID(0) * (size_t)spacing * UBS_VW;
    for (uint k = 0; k < count / 4; ++k) {
      UBS_STORE(UBS_LOAD(at) + (vreal)(value), at);
      UBS_STORE(UBS_LOAD(at + quarter) + (vreal)(value), at + quarter);
      UBS_STORE(UBS_LOAD(at + 2 * quarter) + (vreal)(value), at + 2 * quarter);
      UBS_STORE(UBS_LOAD(at + 3 * quarter) + (vreal)(value), at + 3 * quarter);
      at += (size_t)step * UBS_VW;
    }
  }
}
