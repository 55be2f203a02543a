// SPDX-License-Identifier: Apache-2.0
// Cheaper arithmetic, storage and order than float32 throughout. Each switch is a specialisation of the
// kernels: at its default they are what they are without it, bit for bit. What each costs in accuracy and
// saves in time is measured by `ubs accuracy` (docs/accuracy.md).
#pragma once

#include <string>

namespace ubs {

enum class MathMode { exact, native, rough };  // UBS_MATH in kernels/math/elementary.h

enum class NoiseGate { pow100, sigmoid };  // method.md 4.3; UBS_NOISE_GATE

struct Approximation {
  MathMode math = MathMode::exact;  // of exp2 and log2: polynomials of lower degree, native_* on one lane
  unsigned vector_width = 0;        // lanes of explicit vectors: 1, 4, 8, 16; 0: the device's

  bool operator==(const Approximation&) const = default;
};

// "none" or the switches that are not at their default: "math=native vector_width=4".
std::string to_string(const Approximation& approximation);

}  // namespace ubs
