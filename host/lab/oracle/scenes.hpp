// SPDX-License-Identifier: Apache-2.0
// This file declares seeded test scenes for any dimension N. Models, cameras and target images consist of
// floats, which production code and oracle read identically (cameras and targets are doubles that contain
// float values).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "host/base/random.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::oracle {

struct SceneOptions {
  std::size_t count = 200;
  int dim = 6;
  std::uint64_t seed = 1;
  int width = 64, height = 48;
  // Parameters that the default variant also has get the same random numbers as in the default variant. Other
  // parameters use a separate random stream.
  ModelVariant variant = {};
};

struct Scene {
  SplatModel model;
  Camera camera;
  std::vector<double> target;  // (3, H, W), smooth, in [0,1]
  std::array<double, 3> background{};
};

inline constexpr int kRingCameras = 8;

// Returns camera `index` of a ring of radius 3 around the origin. The camera looks at the origin. fx != fy,
// and the principal point is off-centre. Time and extra queries differ per camera; `extra` has exactly the
// length that the dimension needs.
Camera ring_camera(const SceneOptions& options, int index);
std::vector<double> smooth_target(int width, int height, std::uint64_t seed);

// Returns a scene with splats within +-0.9 of the origin, with moderate anisotropy and query correlations.
// Most of the splats are visible from camera 0. Among every 32 splats, there is one that can exceed alpha
// 0.999, one that is below the tanh floor in every query dimension, one that is beyond the 1.3x limit of the
// projection of camera 0 but reaches into its image, and one that is behind camera 0.
Scene regular_scene(const SceneOptions& options);

// These functions return difficult scenes. All of them use ring camera 0 unless the comment says otherwise.
Scene huge_splat_scene(const SceneOptions& options);       // one splat covers every pixel; `count` is ignored
Scene crowded_tile_scene(const SceneOptions& options);     // all means within pixels [16,32) x [16,32)
Scene behind_camera_scene(const SceneOptions& options);    // nothing visible
Scene empty_scene(const SceneOptions& options);            // zero splats
Scene single_splat_scene(const SceneOptions& options);     // one ordinary splat at the origin
Scene identical_depth_scene(const SceneOptions& options);  // axis-aligned camera, all depths exactly 3
Scene opaque_stack_scene(const SceneOptions& options);     // layers of opacity 0.9, so that pixels stop early

}  // namespace ubs::oracle
