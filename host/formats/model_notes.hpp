// SPDX-License-Identifier: Apache-2.0
// ModelNotes is the information in the header of a ubs model file in addition to the splats: settings for
// rendering the model, and some training cameras. It is stored in comment lines, which other readers,
// including that of the published code, skip:
//   ubs_drawn background=1,1,1 alpha_min=0 ...
//   ubs_lens WIDTH HEIGHT FX FY
//   ubs_camera QW QX QY QZ X Y Z TIME       rotation (world to camera); position in the model's coordinates
//   ubs_up X Y Z                            the up direction that the format of an imported file implies
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "host/scene/camera.hpp"
#include "host/scene/pose.hpp"

namespace ubs {

struct ModelNotes {
  std::vector<std::pair<std::string, std::string>>
      // Settings of rendering (kOfDrawing) with their values, which are texts in the syntax of --set.
      drawing;
  std::vector<Camera> cameras;  // some of the training cameras, in their order
  std::optional<Vec3> up;
};

// Maximum number of stored cameras. It keeps the header short, because each camera has eight numbers.
inline constexpr std::size_t kNotedCameras = 12;

// Returns notes with the given settings. `cameras` are all training cameras; at most kNotedCameras of them,
// at equal intervals, are selected.
ModelNotes make_notes(std::vector<std::pair<std::string, std::string>> drawing,
                      std::span<const Camera> cameras);
// Returns the comment lines that store the notes.
std::vector<std::string> comments_of(const ModelNotes& notes);
// Parses the comments of a header. Missing values stay empty, and unknown keys are skipped. If a line does
// not have the format above, throws Error(data) with a message that starts with `name`.
ModelNotes notes_of(std::span<const std::string> comments, const std::string& name);

}  // namespace ubs
