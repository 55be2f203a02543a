// SPDX-License-Identifier: Apache-2.0
// Models with cameras and images to measure on. Every scene is a function of its arguments: the same in every
// run and on every machine (trained ones as far as training is).
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
  // A model of several dimensions, `model` being its first group: it can be drawn, not trained.
  MixedModel mixed{};
};

// A trained object of two crossed ellipsoids that fills 46 % of the image with about 50 blended splats a
// pixel: log-normal sizes and anisotropies, 45 % of low opacity, mild dependence on the view, no order in
// memory. The statistics are those of the prototypes that the structure of the rasterisers was chosen with.
BenchScene synthetic_object(int dim, std::size_t splats, int width, int height, std::size_t views = 4);

// The start of training: random splats in a box, cameras around it, white background. Beta splats start as in
// method.md 1.3, Gaussians as 3DGS starts them: with the neighbour distance as deviation and opacity 0.1,
// about five times as many blended splats a pixel.
BenchScene random_start(int dim, std::size_t splats, int width, int height, const ModelVariant& variant = {});

// An embedded scene of host/data/synthetic.hpp, trained for `iterations` on 100x100 images.
struct TrainedOptions {
  int dim = 6;
  std::size_t splats = 30'000;
  int width = 200, height = 200, iterations = 300;
  std::string raster = "auto";
  ModelVariant variant = {};
};
BenchScene trained_scene(Device& device, const std::string& scene, const TrainedOptions& options);

// The coloured points of gsplat's test_garden.npz as an initial model, its cameras, made-up images. The
// folder has its arrays as float .npy files (docs/benchmarks.md).
SceneSize garden_size(const std::filesystem::path& folder);
BenchScene garden_scene(const std::filesystem::path& folder, int dim, const ModelVariant& variant = {});

// An image with gradients and edges for scenes that have none.
Image8 made_up_image(int width, int height);

}  // namespace ubs::bench
