// SPDX-License-Identifier: Apache-2.0
// Random displacement of the means (method.md 4.3 step 3), UBS_VW splats a work-item.

UBS_KERNEL void add_noise(UBS_GLOBAL real* params, uint count, uint stride, real amount, uint seed0,
                          uint seed1, uint iteration0, uint iteration1) {
  uint first = UBS_GLOBAL_ID(0) * UBS_VW;
  if (first >= count) return;
  UBS_GLOBAL real* p = params + first;
  size_t n = stride;
  SpatialFrame frame = spatial_frame(
      UBS_LOAD(p + UBS_P_L * n), UBS_LOAD(p + (UBS_P_L + 1) * n), UBS_LOAD(p + (UBS_P_L + 2) * n),
      UBS_LOAD(p + UBS_P_SCALE * n), UBS_LOAD(p + (UBS_P_SCALE + 1) * n),
      UBS_LOAD(p + (UBS_P_SCALE + 2) * n));
  RandomNormals random = random_normals(
      random_words(seed0, seed1, iteration0, iteration1, UBS_DRAW_NOISE, ubs_lane_indices(first)));
  Vec3 normals;
  normals.e[0] = random.x;
  normals.e[1] = random.y;
  normals.e[2] = random.z;
  Vec3 d = noise_displacement(frame, UBS_LOAD(p + UBS_P_OPACITY * n), normals, amount);
  for (int k = 0; k < 3; ++k) {
    UBS_GLOBAL real* x = p + (UBS_P_XYZ + k) * n;
    UBS_STORE(UBS_LOAD(x) + d.e[k], x);
  }
}
