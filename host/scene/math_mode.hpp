// SPDX-License-Identifier: Apache-2.0
// Cheaper arithmetic than float32 throughout. Each mode is a specialisation of the kernels: at `exact` they
// are what they are without it, bit for bit. What it costs in accuracy and saves in time is measured by
// `ubs-lab accuracy` (docs/accuracy.md).
#pragma once

namespace ubs {

// Of exp2 and log2: exact, polynomials of lower degree (native_* on one lane), or of still lower degree.
// UBS_MATH in kernels/math/elementary.h.
enum class MathMode { exact, native, rough };

}  // namespace ubs
