// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace ubs {

// How the exposure and the white balance of training images are optimised (kernels/math/appearance.h): not at
// all, as a gain per channel, or as an affine map of colours.
enum class Appearance { none, gain, affine };

}  // namespace ubs
