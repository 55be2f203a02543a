// SPDX-License-Identifier: Apache-2.0
// IEEE half precision on the host, for finite values.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

namespace ubs {

// To the nearest, ties to even; beyond the largest half infinity.
inline std::uint32_t half_from_float(float x) {
  const std::uint32_t sign = std::bit_cast<std::uint32_t>(x) >> 16 & 0x8000u;
  const float magnitude = std::fabs(x);
  if (magnitude < 0x1p-14f)  // below the normal halves their spacing is 2^-24; nearbyint rounds ties to even
    return sign | static_cast<std::uint32_t>(std::nearbyint(magnitude * 0x1p24f));
  std::uint32_t bits = std::bit_cast<std::uint32_t>(magnitude);
  bits += 0xfffu + (bits >> 13 & 1u);
  const std::uint32_t half = (bits >> 13) - (112u << 10);
  return sign | (half < 0x7c00u ? half : 0x7c00u);
}

// Of the lower 16 bits.
inline float float_from_half(std::uint32_t bits) {
  const std::uint32_t exponent = bits >> 10 & 31u, mantissa = bits & 0x3ffu;
  const float magnitude = exponent == 0 ? static_cast<float>(mantissa) * 0x1p-24f
                                        : std::bit_cast<float>((exponent + 112u) << 23 | mantissa << 13);
  return bits & 0x8000u ? -magnitude : magnitude;
}

}  // namespace ubs
