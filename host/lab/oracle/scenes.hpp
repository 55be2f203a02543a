// SPDX-License-Identifier: Apache-2.0
// This file declares test scenes for any number of dimensions N. Each scene is random, but depends only on
// its options. All numbers of models, cameras and target images are float values, so that kernels and oracle
// use exactly the same numbers. Cameras and targets store these values as double.
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
  std::vector<double> target;  // (3, H, W), a smooth image with values in [0, 1]
  std::array<double, 3> background{};
};

inline constexpr int kRingCameras = 8;

// Returns camera `index` of a ring of radius 3 around the origin. The camera looks at the origin. Its focal
// lengths fx and fy differ, and its principal point is not in the centre of the image. Each camera has a
// different time and different extra query values. `extra` has exactly the number of values that models with
// options.dim dimensions need.
Camera ring_camera(const SceneOptions& options, int index);
// Returns a smooth random image with values in [0, 1] as three planes, like Scene::target.
std::vector<double> smooth_target(int width, int height, std::uint64_t seed);

// Returns a scene with splats within +-0.9 of the origin, with moderate anisotropy and query correlations.
// Most of the splats are visible from camera 0. Among every 32 splats, there is one that can exceed alpha
// 0.999, one whose opacity factor is at the tanh floor in every query dimension, one whose mean is beyond the
// frustum limit of camera 0 (1.3 times the half field of view) although its support reaches into the image,
// and one that is behind camera 0.
Scene regular_scene(const SceneOptions& options);

// These functions return special scenes. All of them use ring camera 0 unless the comment says otherwise. The
// means in these comments are those before conditioning.
Scene huge_splat_scene(const SceneOptions& options);       // one splat covers every pixel; `count` is ignored
Scene crowded_tile_scene(const SceneOptions& options);     // all means are in the pixels [16,32) x [16,32)
Scene behind_camera_scene(const SceneOptions& options);    // no splat is visible
Scene empty_scene(const SceneOptions& options);            // the model has no splats
Scene single_splat_scene(const SceneOptions& options);     // one ordinary splat at the origin
Scene identical_depth_scene(const SceneOptions& options);  // the camera is axis-aligned, all depths are 3
Scene opaque_stack_scene(const SceneOptions& options);     // layers of opacity 0.9, so that pixels stop early

}  // namespace ubs::oracle
