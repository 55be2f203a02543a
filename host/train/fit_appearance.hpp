// SPDX-License-Identifier: Apache-2.0
// The exposure and white balance that bring a render nearest to a photograph, in closed form: held-out views
// have none of their own.
#pragma once

#include <cstdint>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/train/evaluate.hpp"

namespace ubs {

struct PhotographPixels {
  std::vector<std::uint8_t> planes;  // (3, height, width)
  std::vector<std::uint8_t> mask;    // (height, width): 0 = does not count; empty: all do
};

// The twelve numbers of kernels/math/appearance.h with the least squared error, before clamping. A ridge of a
// millionth holds what the pixels do not determine at neutral.
std::vector<float> fit_appearance(const RenderedView& render, const PhotographPixels& photograph,
                                  Appearance fit);

}  // namespace ubs
