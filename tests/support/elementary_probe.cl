// SPDX-License-Identifier: Apache-2.0
// Functions of kernels/math/elementary.h (tests/stages/elementary_test.cpp).
__kernel void elementary_probe(int which, __global const float* in, __global float* out) {
  const uint i = get_global_id(0);
  out[i] = which == 0 ? ubs_log2_1m(in[i]) : which == 1 ? ubs_exp2(in[i]) : ubs_reciprocal(in[i]);
}
