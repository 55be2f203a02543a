// SPDX-License-Identifier: Apache-2.0
// MathMode selects arithmetic that is cheaper and less accurate than float32. Kernels are compiled for one
// mode. `ubs-lab accuracy` measures the loss of accuracy and the saved time (docs/accuracy.md).
#pragma once

namespace ubs {

// The accuracy of exp2 and log2. Vectorised kernels compute both with polynomials: `exact` uses the highest
// degree, `native` a lower degree and `rough` the lowest. Kernels with one value per work-item have only one
// cheaper log2, the native function of the device, which both `native` and `rough` use. The macro UBS_MATH in
// kernels/math/elementary.h selects the mode.
enum class MathMode { exact, native, rough };

}  // namespace ubs
