// SPDX-License-Identifier: Apache-2.0
// The pictures of a run for its report: views beside their ground truth with depth and alpha, the model taken
// apart by its betas, and a strip over time.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "host/api/decompose.hpp"
#include "host/look/report/run_record.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

class Device;

struct DrawnView {
  std::string name;
  std::optional<double> time;       // of models with time
  Image8 render;                    // clamped
  std::optional<Image8> truth;      // of the size of the render
  std::vector<float> alpha, depth;  // (height, width); empty for pictures that the run saved
};

struct DrawnPart {
  std::string name;  // "upper half"
  BetaRange range;
  std::size_t splats = 0;
  Image8 image;
};

struct Decomposition {
  BetaKind kind{};
  bool meaningful = true;  // false: all betas are equal
  std::vector<DrawnPart> parts;
};

struct DrawnTime {
  double time = 0;
  Image8 image;
};

struct RunDrawings {
  std::vector<DrawnView> views;
  std::string apart_view;  // the view of the decompositions and of the strip
  std::vector<Decomposition> decompositions;
  std::vector<DrawnTime> times;  // empty for models without time
};

// `views` (at least one) with images where there are any; the first one is used to take the model apart.
RunDrawings draw_run(Device& device, const MixedModel& model, const TrainSettings& settings,
                     const std::vector<View>& views);

// Returns a camera of width x height pixels, 45 degrees along the shorter side, on the orbit that shows the
// bulk of the model (host/api/scene_frame.hpp) from 25 degrees above, at `azimuth` [rad]. It is for models
// without cameras of their own.
Camera circling_camera(const MixedModel& model, double azimuth, int width, int height);

// The pictures that `ubs train` left in `folder` (ground truth | render), at most `count`, evenly spaced by
// name. Files that are no such pictures are told and left out.
std::vector<DrawnView> saved_renders(const std::filesystem::path& folder, std::size_t count,
                                     std::vector<std::string>& remarks);

// Numbers of at most `count` of `size` things, evenly spaced from the first on.
std::vector<std::size_t> evenly_spaced(std::size_t size, std::size_t count);

}  // namespace ubs
