// SPDX-License-Identifier: Apache-2.0
// RunDrawings holds the images of a run for its report: views with their ground truth, depth and alpha; parts
// of the model selected by their betas; and a series of images over time.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "host/look/report/run_record.hpp"
#include "host/model/decompose.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

class Device;

struct DrawnView {
  std::string name;
  std::optional<double> time;   // only for models with time
  Image8 render;                // clamped to [0, 1]
  std::optional<Image8> truth;  // ground truth; nothing if the view has no image
  // Alpha and depth of each pixel (height, width). They are empty for images that the run saved.
  std::vector<float> alpha, depth;
};

struct DrawnPart {
  std::string name;  // such as "upper half"
  BetaRange range;   // quantiles of the betas of the splats
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
  // Name of the view whose camera is used for `decompositions` and, with other times, for `times`.
  std::string apart_view;
  std::vector<Decomposition> decompositions;
  std::vector<DrawnTime> times;  // empty for models without time
};

// Renders the images. `views` must have at least one view, with or without image; the first one is used for
// the decompositions.
RunDrawings draw_run(Device& device, const MixedModel& model, const TrainSettings& settings,
                     const std::vector<View>& views);

// Returns a camera of width x height pixels with an angle of view of 45 degrees along the shorter side. It is
// on the orbit that shows most of the model (host/model/scene_frame.hpp) from 25 degrees above, at `azimuth`
// [rad]. It is used for models without cameras.
Camera circling_camera(const MixedModel& model, double azimuth, int width, int height);

// Returns at most `count` of the images that `ubs train` saved in `folder`, evenly spaced in the order of
// their names. Each file contains the ground truth on the left and the render on the right. Files that cannot
// be read, or whose width is odd, are skipped with a remark.
std::vector<DrawnView> saved_renders(const std::filesystem::path& folder, std::size_t count,
                                     std::vector<std::string>& remarks);

// Returns the indices of at most `count` of `size` items, evenly spaced, starting with the first.
std::vector<std::size_t> evenly_spaced(std::size_t size, std::size_t count);

}  // namespace ubs
