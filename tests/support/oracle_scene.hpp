// SPDX-License-Identifier: Apache-2.0
// settings_of() and target_of() convert the background and the target image of a scene of the oracle
// (host/lab/oracle/scenes.hpp) to the types that the renderer uses.
#pragma once

#include <vector>

#include "host/lab/oracle/scenes.hpp"
#include "host/pipeline/renderer.hpp"

namespace ubs::test {

inline RenderSettings settings_of(const oracle::Scene& scene) {
  RenderSettings settings;
  for (std::size_t c = 0; c < 3; ++c) settings.background[c] = static_cast<float>(scene.background[c]);
  return settings;
}

inline std::vector<float> target_of(const oracle::Scene& scene) {
  return {scene.target.begin(), scene.target.end()};
}

}  // namespace ubs::test
