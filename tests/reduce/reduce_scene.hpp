// SPDX-License-Identifier: Apache-2.0
// Defines functions that copy some splats of a model, and a small scene with splats that `ubs reduce` can
// remove or convert to fewer dimensions.
#pragma once

#include <numeric>
#include <vector>

#include "host/lab/oracle/scenes.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs::test {

inline SplatModel selection(const SplatModel& model, const std::vector<std::size_t>& splats) {
  SplatModel out(model.dim, splats.size(), model.variant);
  for (int r = 0; r < model.layout().count; ++r)
    for (std::size_t i = 0; i < splats.size(); ++i) out.row(r)[i] = model.row(r)[splats[i]];
  return out;
}

inline SplatModel part(const SplatModel& model, std::size_t first, std::size_t end) {
  std::vector<std::size_t> splats(end - first);
  std::iota(splats.begin(), splats.end(), first);
  return selection(model, splats);
}

// ReduceScene is a regular scene with 300 splats. Splats with i % 10 == 1 have an opacity of 0. Splats with
// i % 10 == 2 are far outside all views. On splats with i % 10 == 3, no query value has an effect. If N = 7,
// half of these splats (i % 20 == 13) are different: the direction has an effect on them, but the time has
// none.
struct ReduceScene {
  MixedModel model;
  std::vector<Camera> cameras;  // kTraining training views and one test view
  // The number of training views, and the number of splats of each of the kinds above.
  static constexpr std::size_t kTraining = 5, kEach = 30;

  explicit ReduceScene(int dim) {
    const oracle::SceneOptions options{.count = 300, .dim = dim, .seed = 40, .width = 61, .height = 45};
    SplatModel model = oracle::regular_scene(options).model;
    const ParameterLayout l = model.layout();
    for (std::size_t i = 0; i < model.count; ++i) {
      if (i % 10 == 1) model.row(l.opacity)[i] = -200;
      if (i % 10 == 2) model.row(l.xyz + 1)[i] = 500;
      if (i % 10 != 3) continue;
      const bool time = dim == 7 && i % 20 == 13;
      for (int q = 0; q < l.query; ++q) {
        if (time && q < 3) continue;
        model.row(l.query_beta + q)[i] = -120;
        if (time)
          for (int c = 0; c < 3 + q; ++c) model.row(l.l_triangle + (3 + q) * (2 + q) / 2 + c)[i] = 0;
      }
    }
    this->model = MixedModel(std::move(model));
    for (int c = 0; c <= static_cast<int>(kTraining); ++c) cameras.push_back(oracle::ring_camera(options, c));
  }
  std::vector<Camera> training() const { return {cameras.begin(), cameras.begin() + kTraining}; }
};

}  // namespace ubs::test
