// SPDX-License-Identifier: Apache-2.0
// What the sweeps vary: random splats whose one property is set to the stiff quantity x.
#pragma once

#include <random>
#include <string>
#include <vector>

#include "host/device/stages.hpp"
#include "host/scene/camera.hpp"
#include "host/scene/model_variant.hpp"

namespace ubs::stress {

using Generator = std::mt19937_64;
double uniform(Generator& g, double low, double high);

struct SweepSplat {
  std::vector<float> raw;  // rows of ParameterLayout(dim, variant)
  double radius2 = 0.95;   // points are taken at r below this
};

// Of one form of the method, seen by one camera at a time, whose values are floats, so that device and
// reference agree about them.
struct SweepSet {
  int dim = 6;
  Camera camera;
  ProjectionSettings settings;
  std::vector<SweepSplat> splats;
  ModelVariant variant = {};
};

// A stack of projected splats, front to back: fields x, y, L00, L01, L11, opacity, beta, r, g, b of each.
inline constexpr int kStackFields = 10;
struct SweepStack {
  std::vector<float> fields;
  std::vector<float> x, y;  // points
  // Where the points are a part of the support: its share of the area, and as many points of all of it,
  // against which errors are then measured.
  double share = 1;
  std::vector<float> whole_x, whole_y;
};

struct SweepCase {
  std::string name, title, x_label;
  double low, high;
  int points;
  SweepSet (*splats)(double x, int count, Generator& g);                 // either
  std::vector<SweepStack> (*stacks)(double x, int count, Generator& g);  // or
  bool has_naive = true;
};
const std::vector<SweepCase>& sweep_cases();

inline constexpr int kSweepPoints = 64;  // of a splat or stack

}  // namespace ubs::stress
