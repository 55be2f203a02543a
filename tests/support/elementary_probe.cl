// SPDX-License-Identifier: Apache-2.0
// This kernel evaluates a function of kernels/math/elementary.h with vectors of UBS_VW values. `which`
// selects the function. tests/stages/elementary_test.cpp launches the kernel.
__kernel void elementary_probe(int which, __global const float* in, __global float* out) {
  const uint first = get_global_id(0) * UBS_VW;
  const vreal x = UBS_LOAD(in + first);
  vreal y = ubs_log2_1m(x);
  if (which == 1) y = ubs_exp2(x);
  if (which == 2) y = ubs_reciprocal(x);
  if (which == 3) y = ubs_exp(x);
  if (which == 4) y = ubs_log1p(x);
  UBS_STORE(y, out + first);
}
