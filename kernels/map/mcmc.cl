// SPDX-License-Identifier: Apache-2.0
// Relocation and growth (method.md 4.3), one work-item a splat. The draws count the copies of each source with
// integer atomics, whose result does not depend on the order. Compiled with UBS_VW = 1: the copies gather, and the
// event is rare.
//   weights -> prefix sum -> draw -> sources -> copies

// alive_only: relocation samples live splats, so that weight 0 marks the dead.
UBS_KERNEL void mcmc_weights(UBS_GLOBAL const real* params, uint count, uint stride, uint alive_only,
                             UBS_GLOBAL uint* weights, UBS_GLOBAL uint* copies) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count) return;
  real raw = params[(size_t)kRowOpacity * stride + i];
  weights[i] = (uint)(alive_only ? sampling_weight_alive(raw) : sampling_weight(raw));
  copies[i] = 0;
}

// The splat whose share [prefix[i], prefix[i + 1]) holds `ticket`; weight 0 is an empty share.
UBS_FN uint find_share(UBS_GLOBAL const ulong* prefix, uint count, ulong ticket) {
  uint low = 0, high = count;  // prefix[low] <= ticket < prefix[high]
  while (high - low > 1) {
    uint middle = low + (high - low) / 2;
    if (prefix[middle] <= ticket)
      low = middle;
    else
      high = middle;
  }
  return low;
}

// Slot i draws a source if its weight is 0 (relocation, slots = count, `weights` given) or always
// (growth, `weights` null). totals[0] counts the slots that got one.
UBS_KERNEL void mcmc_draw(UBS_GLOBAL const ulong* prefix, UBS_GLOBAL const uint* weights, uint count, uint slots,
                          uint purpose, uint seed0, uint seed1, uint iteration0, uint iteration1,
                          UBS_GLOBAL uint* sources, UBS_GLOBAL uint* copies, UBS_GLOBAL uint* totals) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= slots) return;
  ulong total = prefix[count];
  sources[i] = UBS_NO_SOURCE;
  if (weights && (weights[i] != 0 || total == 0)) return;
  RandomWords words = random_words(seed0, seed1, iteration0, iteration1, purpose, i);
  // 64 random bits times n, high word: uniform on 0 .. n - 1 but for a relative n / 2^64 (5e-6 for six million
  // splats of opacity 1). Growth must fill its slots even if every opacity is zero or NaN: all splats are then alike.
  ulong ticket = ubs_mul_hi64((ulong)words.x << 32 | words.y, total > 0 ? total : count);
  uint source = total > 0 ? find_share(prefix, count, ticket) : (uint)ticket;
  sources[i] = source;
  ubs_count(copies + source);
  ubs_count(totals);
}

// Sources take their share of their own opacity and start with fresh moments.
UBS_KERNEL void mcmc_sources(UBS_GLOBAL real* params, uint count, uint stride, UBS_GLOBAL const uint* copies,
                             UBS_GLOBAL real* moment1, UBS_GLOBAL real* moment2) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count || copies[i] == 0) return;
  size_t opacity = (size_t)kRowOpacity * stride + i;
  params[opacity] = split_raw_opacity(params[opacity], (real)copies[i] + R(1.0));
  for (uint row = 0; row < kTrainedRows; ++row) {
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
  for (uint row = 0; row < kRowCount; ++row) {
    size_t at = (size_t)row * stride;
    params[at + first + i] = params[at + source];
  }
  for (uint row = 0; row < kTrainedRows; ++row) {
    moment1[(size_t)row * stride + first + i] = R(0.0);
    moment2[(size_t)row * stride + first + i] = R(0.0);
  }
}
