// SPDX-License-Identifier: Apache-2.0
// BenchScene is a model with cameras and images for benchmarks. Every scene depends only on its arguments, so
// it is the same in every run and on every machine (for trained scenes, as far as training is reproducible).
#pragma once

#include <filesystem>
#include <string>

#include "host/device/device.hpp"
#include "host/lab/bench/bench_case.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::bench {

struct BenchScene {
  SplatModel model;
  Split views;  // with images
  std::array<float, 3> background{0, 0, 0};
  // Used only if the splats of the model have different dimensions. Then `model` is the first group of
  // `mixed`, and the scene can be rendered, but not trained.
  MixedModel mixed{};
};

// Returns a scene that resembles a trained object. Its silhouette consists of two crossed ellipses that fill
// 46 % of the image. About 50 splats are blended per pixel of the object. Sizes and anisotropies are
// log-normal, and 45 % of the splats have a low opacity. The splats depend slightly on the view and are
// stored in random order. The prototypes that were used to choose the structure of the rasterisers had the
// same statistics.
BenchScene synthetic_object(int dim, std::size_t splats, int width, int height, std::size_t views = 4);

// Returns a scene at the start of training: random splats in a box, cameras around the box, and a white
// background. Beta splats start as in docs/method.md, section 1.3. Gaussians start as in 3DGS, with the
// neighbour distance as standard deviation and opacity 0.1. This gives about five times as many blended
// splats per pixel as the start of Beta splats.
BenchScene random_start(int dim, std::size_t splats, int width, int height, const ModelVariant& variant = {});

// TrainedOptions describes a scene of trained_scene().
struct TrainedOptions {
  int dim = 6;
  std::size_t splats = 30'000;
  int width = 200, height = 200, iterations = 300;
  std::string raster = "auto";
  ModelVariant variant = {};
};
// Returns a built-in scene of host/dataset/synthetic.hpp, trained for `iterations` iterations on images of at
// most 100x100 pixels.
BenchScene trained_scene(Device& device, const std::string& scene, const TrainedOptions& options);

// garden_scene() returns a scene whose initial model consists of the coloured points of gsplat's
// test_garden.npz. The scene has the cameras of this file and synthetic images. garden_size() returns the
// size of this scene. The folder must contain the arrays of the file as float .npy files
// (docs/benchmarks.md).
SceneSize garden_size(const std::filesystem::path& folder);
BenchScene garden_scene(const std::filesystem::path& folder, int dim, const ModelVariant& variant = {});

// Returns an image with gradients and edges, for scenes without images.
Image8 made_up_image(int width, int height);

}  // namespace ubs::bench
