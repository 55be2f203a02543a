// SPDX-License-Identifier: Apache-2.0
// What the backward rasteriser does with one splat at one pixel (kernels/math/blend.h), and how the sums over pixels
// become a slot.

constexpr int kSums = 10;  // of blend_vjp

// What one pixel carries from splat to splat.
struct PixelState {
  float x, y, open, remaining, v_r, v_g, v_b;
};

// At the start of a segment of the list; state: open transmittance, colour composited in front of it.
__device__ __forceinline__ PixelState start_pixel(const TilePixel& pixel, int plane, const float* image,
                                                  const float* v_image, float4 state) {
  PixelState p;
  p.x = pixel.x;
  p.y = pixel.y;
  p.v_r = v_image[pixel.index];
  p.v_g = v_image[plane + pixel.index];
  p.v_b = v_image[2 * plane + pixel.index];
  p.remaining = (image[pixel.index] - state.y) * p.v_r + (image[plane + pixel.index] - state.z) * p.v_g +
                (image[2 * plane + pixel.index] - state.w) * p.v_b;
  p.open = state.x;
  return p;
}

// Adds the part of one splat at one pixel to `sums`; not `active`: the splat is none of this pixel's block.
__device__ __forceinline__ BlendSums visit(const BlendSums& sums, const BatchSplat& s, bool active, PixelState& p) {
  const float dx = s.x - p.x, dy = s.y - p.y;
  const BlendAlpha a = blend_alpha(s.splat, dx, dy);
  BlendStep step = blend_step(a, p.open);
  step.composited = step.composited && active;
  step.weight = active ? step.weight : 0.0f;
  const float remaining = blend_remaining(s.splat, step, p.remaining, p.v_r, p.v_g, p.v_b);
  const BlendSums v = blend_vjp(sums, s.splat, a, step, p.open, remaining, p.v_r, p.v_g, p.v_b);
  if (active) {
    p.remaining = remaining;
    p.open = step.open;
  }
  return v;
}

// Value `value` of a slot from its sum over the pixels; v_y mixes that of hp with its own, the others only get a
// factor.
__device__ __forceinline__ float slot_value(int value, float sum, float hp, const BlendFactors& f) {
  float out = sum;
  if (value == kGradX) out = f.xp * sum;
  if (value == kGradY) out = f.yp * hp + f.yq * sum;
  if (value >= kGradW00 && value <= kGradW11) out = f.square * sum;
  if (value == kGradBeta) out = UBS_LN2 * sum;
  return out;
}
