// SPDX-License-Identifier: Apache-2.0
// What the header of a model file of ours says beside the splats: how the model wants to be drawn, and from
// where its images were taken. Comment lines that other readers, the published one too, skip:
//   ubs_drawn background=1,1,1 alpha_min=0 ...
//   ubs_lens WIDTH HEIGHT FX FY
//   ubs_camera QW QX QY QZ X Y Z TIME       world to camera, position in the coordinates of the model
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs {

struct ModelNotes {
  std::vector<std::pair<std::string, std::string>>
      drawing;                  // settings (kOfDrawing) and their values as --set has them
  std::vector<Camera> cameras;  // some of those that the model was learnt from, in their order
};

inline constexpr std::size_t kNotedCameras = 12;  // about 100 numbers

// `cameras`: all of them; evenly spaced ones are taken.
ModelNotes make_notes(std::vector<std::pair<std::string, std::string>> drawing,
                      std::span<const Camera> cameras);
std::vector<std::string> comments_of(const ModelNotes& notes);
// From the comments of a header; what is not there stays empty, and a key that is none of ours is left out.
// Throws Error(data) that starts with `name` for lines that are not as above.
ModelNotes notes_of(std::span<const std::string> comments, const std::string& name);

}  // namespace ubs
