// SPDX-License-Identifier: Apache-2.0
// MathMode selects arithmetic that is cheaper and less accurate than float32. Each mode is a specialisation
// of the kernels; with `exact`, the kernels are bit-identical to kernels without this switch. `ubs-lab
// accuracy` measures the loss of accuracy and the saved time (docs/accuracy.md).
#pragma once

namespace ubs {

// The accuracy of exp2 and log2: exact, polynomials of lower degree (native_* on single lanes), or
// polynomials of even lower degree. This is UBS_MATH in kernels/math/elementary.h.
enum class MathMode { exact, native, rough };

}  // namespace ubs
