// SPDX-License-Identifier: Apache-2.0
// Defines helpers for tests that train: built-in scenes, settings of short runs, and a function that trains.
#pragma once

#include <cstring>
#include <vector>

#include "host/dataset/blender.hpp"
#include "host/dataset/synthetic.hpp"
#include "host/scene/initialise.hpp"
#include "host/train/trainer.hpp"
#include "tests/support/published.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::test {

struct Data {
  Split train, test;
};

inline Data load(const std::filesystem::path& folder) {
  return {load_blender_split(folder, "train"), load_blender_split(folder, "test")};
}

inline Data synthetic(const std::string& scene, int size, int views) {
  const TempFolder folder;
  SyntheticOptions options;
  options.scene = scene;
  options.width = options.height = size;
  options.train_views = views;
  options.test_views = 4;
  export_synthetic(options, folder.path() / scene);
  return load(folder.path() / scene);
}

inline TrainSettings short_run(int dim, int iterations, int splats) {
  TrainSettings settings = published(dim);
  settings.iterations = iterations;
  settings.init_points = splats;
  settings.cap_max = splats;
  return settings;
}

// An empty split, for training runs without test views.
inline const Split kNone{"test", {}};

inline SplatModel start(const TrainSettings& s) {
  return initialise_random(s.dim, static_cast<std::size_t>(s.init_points), s.seed);
}

inline bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

struct Outcome {
  SplatModel model;
  Metrics test;
  std::vector<double> losses;
};

inline Outcome train(Device& device, const TrainSettings& settings, const Data& data) {
  Trainer trainer(device, settle(settings), data.train, data.test,
                  initialise_random(settings.dim, static_cast<std::size_t>(settings.init_points),
                                    settings.seed, {.variant = settings.variant}));
  Outcome outcome;
  trainer.run([&](const StepReport& report) {
    if (report.loss) outcome.losses.push_back(*report.loss);
    if (report.test) outcome.test = *report.test;
    return true;
  });
  outcome.model = trainer.model();
  return outcome;
}

}  // namespace ubs::test
