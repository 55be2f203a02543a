// SPDX-License-Identifier: Apache-2.0
// One question of a stress run: a model seen by a camera, and weights of its pixels. What is compared is the
// image and the gradient of sum(weights * image), so that nothing but the renderer is in between.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::stress {

struct Case {
  std::string name;
  std::uint64_t seed = 0;  // of the weights
  SplatModel model;
  Camera camera;
  RenderSettings settings;
  bool query_grad = false;
  bool exact = false;  // thresholds are met exactly in single precision: no pixel is left out
};

// (3, H, W), in (-1, 1). A pixel keeps its weights when the image is cropped on the right or at the bottom.
std::vector<float> pixel_weights(const Case& c);

// A folder that shows the case to other subcommands: model.ply (where all values are finite), a Blender data
// folder with the camera as view 0 of `test`, and case.json, which holds everything to the last bit and is
// what load_case reads. Throws Error(data).
void save_case(const Case& c, const std::filesystem::path& folder);
Case load_case(const std::filesystem::path& folder);

}  // namespace ubs::stress
