// SPDX-License-Identifier: Apache-2.0
// This file contains the kernels of relocation and growth (method.md 4.3). Both choose source splats at random and copy
// them: relocation to the places of dead splats, growth to new places. The kernels have one work-item per splat. They
// count the copies of each source with integer atomics, whose result does not depend on the order. They are compiled
// with UBS_VW = 1, because copies read from arbitrary splats, and because relocations are rare. The kernels run in this
// order:
//   mcmc_weights, prefix sums of the weights, mcmc_draw, mcmc_sources, mcmc_copies, mcmc_places

// Computes the weight with which each splat is drawn as a source. If alive_only is 1, dead splats get the weight 0, so
// that relocation samples only live splats and recognises the dead ones.
UBS_KERNEL void mcmc_weights(UBS_GLOBAL const real* params, uint count, uint stride, uint alive_only,
                             UBS_GLOBAL uint* weights, UBS_GLOBAL uint* copies) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count) return;
  real raw = params[(size_t)kRowOpacity * stride + i];
  weights[i] = (uint)(alive_only ? sampling_weight_alive(raw) : sampling_weight(raw));
  copies[i] = 0;
}

// Returns the splat i whose interval [prefix[i], prefix[i + 1]) contains `ticket`. A splat with the weight 0 has an
// empty interval.
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

// Draws a random source for each slot that receives a copy. For relocation, `slots` is `count`, and the slots i with
// weights[i] = 0 receive a copy. For growth, `weights` is null, and all slots receive a copy. totals[0] counts the
// slots that got a source.
UBS_KERNEL void mcmc_draw(UBS_GLOBAL const ulong* prefix, UBS_GLOBAL const uint* weights, uint count, uint slots,
                          uint purpose, uint seed0, uint seed1, uint iteration0, uint iteration1,
                          UBS_GLOBAL uint* sources, UBS_GLOBAL uint* copies, UBS_GLOBAL uint* totals) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= slots) return;
  ulong total = prefix[count];
  sources[i] = UBS_NO_SOURCE;
  if (weights && (weights[i] != 0 || total == 0)) return;
  RandomWords words = random_words(seed0, seed1, iteration0, iteration1, purpose, i);
  // The upper half of the product of 64 random bits and n is uniform on 0 .. n - 1, except for a relative error of
  // n / 2^64 (5e-6 for six million splats of opacity 1). Growth must fill its slots even if every opacity is zero or
  // NaN; then all splats have the same probability.
  ulong ticket = ubs_mul_hi64((ulong)words.x << 32 | words.y, total > 0 ? total : count);
  uint source = total > 0 ? find_share(prefix, count, ticket) : (uint)ticket;
  sources[i] = source;
  ubs_count(copies + source);
  ubs_count(totals);
}

// Multiplies the spatial size of the splat whose parameters start at p by `shrink`.
UBS_FN void shrink_splat(UBS_GLOBAL real* p, size_t stride, real shrink) {
  for (int c = 0; c < 3; ++c) {
    UBS_GLOBAL real* scale = p + (kRowScale + c) * stride;
    *scale = copy_raw_scale(*scale, shrink);
  }
  // With cholesky, these are the other entries of M.
  for (int m = 0; m < (UBS_COV_PARAM == UBS_COV_CHOLESKY ? kFrameRots : 0); ++m) p[frame_row(m) * stride] *= shrink;
  // The covariance of position and query, M Lqx^T, or the motion with direct conditioning, which is proportional to the
  // size and to Theta (direct.h), do not change. With skew_nd, only the size changes.
  for (int q = 0; q < (UBS_COV_PARAM == UBS_COV_SKEW_ND ? 0 : UBS_C); ++q)
    for (int c = 0; c < 3; ++c) p[(kRowL + UBS_TRIANGLE(3 + q, c)) * stride] *= R(1.0) / shrink;
}

// Reduces the opacity of each source, because its copies take over a part of its effect, and resets the moments of the
// source. If `spread` is not 0, its size is reduced as well.
UBS_KERNEL void mcmc_sources(UBS_GLOBAL real* params, uint count, uint stride, UBS_GLOBAL const uint* copies,
                             real spread, UBS_GLOBAL real* moment1, UBS_GLOBAL real* moment2) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count || copies[i] == 0) return;
  size_t opacity = (size_t)kRowOpacity * stride + i;
  params[opacity] = split_raw_opacity(params[opacity], (real)copies[i] + R(1.0));
  if (spread != R(0.0)) shrink_splat(params + i, stride, copy_shrink(spread));
  for (uint row = 0; row < kTrainedRows; ++row) {
    moment1[(size_t)row * stride + i] = R(0.0);
    moment2[(size_t)row * stride + i] = R(0.0);
  }
}

// Copies all rows of splat sources[i] to slot first + i, unless sources[i] is UBS_NO_SOURCE. A source is never a slot
// that is written, so the order of the work-items does not matter.
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

// Displaces the copies in the slots first, first + 1, ... by random vectors (copy_displacement() of math/mcmc.h). The
// random numbers of slot first + i depend on first_number + i.
UBS_KERNEL void mcmc_places(UBS_GLOBAL real* params, uint stride, uint first, uint slots,
                            UBS_GLOBAL const uint* sources, real spread, uint purpose, uint seed0, uint seed1,
                            uint iteration0, uint iteration1, uint first_number) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= slots || sources[i] == UBS_NO_SOURCE) return;
  UBS_GLOBAL real* p = params + first + i;
  size_t n = stride;
  FrameRaw raw;
  for (int m = 0; m < kFrameRots; ++m) raw.rotation[m] = p[frame_row(m) * n];
  for (int c = 0; c < UBS_F; ++c) raw.scale[c] = p[(kRowScale + c) * n];
  RandomNormals random =
      random_normals(random_words(seed0, seed1, iteration0, iteration1, purpose, first_number + i));
  Vec3 normals;
  normals.e[0] = random.x;
  normals.e[1] = random.y;
  normals.e[2] = random.z;
  Vec3 d = copy_displacement(spatial_frame(raw), normals, spread);
  for (int k = 0; k < 3; ++k) p[(kRowXyz + k) * n] += d.e[k];
}
