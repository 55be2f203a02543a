// SPDX-License-Identifier: Apache-2.0
// Provides one form of the mathematics of a splat (splat_form.hpp) for splat_vjp_test.cpp, in double
// precision. Macros that the build defines select the form. UBS_TEST_VARIANT is the name of a variant. The
// tests are not in this file, so that for each form only the functions of the kernels are compiled.
#include "tests/math/splat_form.hpp"

#include <algorithm>
#include <iterator>
#include <tuple>

#define UBS_STRING2(x) #x
#define UBS_STRING(x) UBS_STRING2(x)
#ifdef UBS_TEST_VARIANT
#define UBS_FORM_NAME UBS_STRING(UBS_TEST_VARIANT) ", N=" UBS_STRING(UBS_N)
#elif defined(UBS_CAMERA_GRAD)
#define UBS_FORM_NAME "camera, N=" UBS_STRING(UBS_N)
#elif defined(UBS_QUERY_GRAD)
#define UBS_FORM_NAME "query gradient, N=" UBS_STRING(UBS_N)
#else
#define UBS_FORM_NAME "N=" UBS_STRING(UBS_N)
#endif

namespace ubs::test {
namespace {

static_assert(kRowCount <= std::tuple_size_v<SplatValues>);

SplatRaw raw_of(const SplatValues& values) {
  SplatRaw raw;
  std::copy_n(values.begin(), std::size_t{kRowCount}, raw.e);
  return raw;
}

SplatState state(const CameraView& cam, const SplatRaw& raw) {
  return splat_state(cam, raw, view_ray_ahead(cam, raw), 1);
}

SplatImage image(const CameraView& cam, const SplatValues& values) {
  const SplatRaw raw = raw_of(values);
  return splat_image(raw, state(cam, raw));
}

SplatValues gradient(const CameraView& cam, const SplatValues& values, const SplatImageVjp& v) {
  const SplatRaw raw = raw_of(values);
  const SplatVjp gradient = splat_vjp(cam, raw, view_ray_ahead(cam, raw), v, 1);
  SplatValues out{};
  std::copy(std::begin(gradient.e), std::end(gradient.e), out.begin());
  return out;
}

SplatInside inside(const CameraView& cam, const SplatValues& values) {
  const SplatRaw raw = raw_of(values);
  const SplatState s = state(cam, raw);
  const ThinSplats thin = splat_thin(raw);
  SplatInside out{};
  std::copy(std::begin(s.frame.scale.e), std::end(s.frame.scale.e), out.scale);
  out.lifted = thin.lifted != 0;
  out.coupled = thin.coupled != 0;
#if UBS_C > 0 && UBS_COV_PARAM != UBS_COV_SKEW_ND && !UBS_DIRECT
  out.from_factor = s.coupled != 0;
  for (int i = 0; i < UBS_C; ++i) {
    out.x[i] = s.slice_in.x.e[i];
    for (int k = 0; k < 3 + UBS_C; ++k) out.b[i][k] = s.slice_in.b[i][k];
  }
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      out.frame[r][c] = s.frame.m.e[r][c];
      out.sum[r][c] = s.conditional.shrink.e[r][c];
      out.m[r][c] = s.m.e[r][c];
      out.shrink[r][c] = s.shrink.e[r][c];
    }
#endif
  return out;
}

#ifdef UBS_QUERY_GRAD
constexpr bool kQueryGrad = true;
#else
constexpr bool kQueryGrad = false;
#endif
#ifdef UBS_CAMERA_GRAD
constexpr bool kCameraGrad = true;
#else
constexpr bool kCameraGrad = false;
#endif

const SplatForm form{
    UBS_FORM_NAME,
    UBS_N,
    {UBS_ROT_MODE, UBS_COV_PARAM, UBS_BETA_COND, UBS_BETA_OPACITY, UBS_COV_MODE, UBS_FALLOFF, UBS_COLOUR,
     UBS_ANTIALIAS, UBS_DIRECT},
    kQueryGrad,
    kCameraGrad,
    UBS_DEPTH_GRAD != 0,
    {kRowXyz, kRowRgb, kRowOpacity, kRowBeta, kRowQueryBeta, kRowMean, kRowScale, kRowL, kRowCount},
    UBS_SH_COUNT,
    UBS_QUERY_SCALE_LEAST,
    UBS_SCALE_LEAST,
    image,
    gradient,
    inside};
[[maybe_unused]] const bool listed = (splat_forms().push_back(&form), true);

}  // namespace
}  // namespace ubs::test
