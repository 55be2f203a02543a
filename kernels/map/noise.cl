// SPDX-License-Identifier: Apache-2.0
// Adds a random displacement to the means (method.md 4.3 step 3). One work-item processes UBS_VW splats. `first_number`
// is the index that the first splat of `params` has in the whole model. The random numbers depend on this index.

UBS_KERNEL void add_noise(UBS_GLOBAL real* params, uint count, uint stride, real amount, uint seed0,
                          uint seed1, uint iteration0, uint iteration1, uint first_number) {
  uint first = UBS_GLOBAL_ID(0) * UBS_VW;
  if (first >= count) return;
  UBS_GLOBAL real* p = params + first;
  size_t n = stride;
  FrameRaw raw;
  UBS_UNROLL for (int m = 0; m < kFrameRots; ++m) raw.rotation[m] = UBS_LOAD(p + frame_row(m) * n);
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) raw.scale[c] = UBS_LOAD(p + (kRowScale + c) * n);
  SpatialFrame frame = spatial_frame(raw);
  RandomNormals random = random_normals(
      random_words(seed0, seed1, iteration0, iteration1, kDrawNoise,
                   ubs_lane_indices(first + first_number)));
  Vec3 normals;
  normals.e[0] = random.x;
  normals.e[1] = random.y;
  normals.e[2] = random.z;
  Vec3 d = noise_displacement(frame, UBS_LOAD(p + kRowOpacity * n), normals, amount);
  for (int k = 0; k < 3; ++k) {
    UBS_GLOBAL real* x = p + (kRowXyz + k) * n;
    UBS_STORE(UBS_LOAD(x) + d.e[k], x);
  }
}
