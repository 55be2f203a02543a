// SPDX-License-Identifier: Apache-2.0
// fit_appearance() computes in closed form the exposure and white balance that bring a render closest to a
// photograph. It is needed for held-out views, because training only optimises the appearance of training
// images.
#pragma once

#include <cstdint>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/train/evaluate.hpp"

namespace ubs {

// PhotographPixels holds the pixels of a photograph.
struct PhotographPixels {
  std::vector<std::uint8_t> planes;  // (3, height, width)
  std::vector<std::uint8_t> mask;    // (height, width); 0: the pixel is ignored; empty: no pixel is ignored
};

// Returns the twelve numbers of the colour map in kernels/math/appearance.h that minimise the squared error
// between the mapped render, which is not clamped, and the photograph. A small regularisation (1e-6 per
// pixel) keeps numbers that the pixels do not determine at their neutral values. If `fit` is
// Appearance::gain, only the three gains are fitted, and the other nine numbers are 0.
std::vector<float> fit_appearance(const RenderedView& render, const PhotographPixels& photograph,
                                  Appearance fit);

}  // namespace ubs
