// SPDX-License-Identifier: Apache-2.0
// Relocation and growth (method.md 4.3), one work-item a splat. The draws between these steps count the
// copies of each source with integer atomics: kernels/opencl/mcmc_draw.cl. Compiled with UBS_VW = 1:
// the copies gather, and the event is rare.
//   weights -> prefix sum -> draw -> sources -> copies

// alive_only: relocation samples live splats, so that weight 0 marks the dead.
UBS_KERNEL void mcmc_weights(UBS_GLOBAL const real* params, uint count, uint stride, uint alive_only,
                             UBS_GLOBAL uint* weights, UBS_GLOBAL uint* copies) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count) return;
  real raw = params[(size_t)UBS_P_OPACITY * stride + i];
  weights[i] = (uint)(alive_only ? sampling_weight_alive(raw) : sampling_weight(raw));
  copies[i] = 0;
}

// Sources take their share of their own opacity and start with fresh moments.
UBS_KERNEL void mcmc_sources(UBS_GLOBAL real* params, uint count, uint stride, UBS_GLOBAL const uint* copies,
                             UBS_GLOBAL real* moment1, UBS_GLOBAL real* moment2) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count || copies[i] == 0) return;
  size_t opacity = (size_t)UBS_P_OPACITY * stride + i;
  params[opacity] = split_raw_opacity(params[opacity], (real)copies[i] + R(1.0));
  for (uint row = 0; row < UBS_TRAINED_ROWS; ++row) {
    moment1[(size_t)row * stride + i] = R(0.0);
    moment2[(size_t)row * stride + i] = R(0.0);
  }
}

// Slot first + i receives all rows of sources[i], where that is a splat (UBS_NO_SOURCE is not). A source
// is never a slot that is written, so the order of the work-items does not matter.
UBS_KERNEL void mcmc_copies(UBS_GLOBAL real* params, uint stride, uint first, uint slots,
                            UBS_GLOBAL const uint* sources, UBS_GLOBAL real* moment1,
                            UBS_GLOBAL real* moment2) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= slots || sources[i] == UBS_NO_SOURCE) return;
  uint source = sources[i];
  for (uint row = 0; row < UBS_PARAMS; ++row) {
    size_t at = (size_t)row * stride;
    params[at + first + i] = params[at + source];
  }
  for (uint row = 0; row < UBS_TRAINED_ROWS; ++row) {
    moment1[(size_t)row * stride + first + i] = R(0.0);
    moment2[(size_t)row * stride + first + i] = R(0.0);
  }
}
