// SPDX-License-Identifier: Apache-2.0
// PathOptions has the options of a camera path and returns the views along it. `ubs render --path` renders
// these instead of the views of a data folder.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <span>
#include <string>

#include "host/dataset/image.hpp"
#include "host/formats/splat_file.hpp"
#include "host/model/camera_path.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::tools {

// Parses a size such as "640x480". Throws Error(usage) for other texts and for sizes outside of 1 to 16384.
ImageSize parse_size(const std::string& option, const std::string& text);
// Parses a vector such as "1,-2.5,0", or an axis: "x", "-y". Throws Error(usage) for other texts.
Vec3 parse_vector(const std::string& option, const std::string& text);

inline constexpr const char* kUpHelp =
    "up direction of the scene: a vector, or an axis such as -y [the mean up direction of the cameras; "
    "without cameras, away from the floor, if one is found in the splats; otherwise z, or -y for third-party "
    "files]";
// Returns the hints for scene_frame() that the model file contains: the up direction, if it states one.
FrameHints frame_hints(const LoadedModel& model);

// Warns if one of the times that the user chose with --time is not between 0 and 1, the range of the training
// times.
void warn_of_other_times(const std::string& text, std::span<const double> times);

class PathOptions {
 public:
  explicit PathOptions(CLI::App& app);
  PathOptions(const PathOptions&) = delete;

  // Selects a path for a model without data, unless the user chose one. The path depends on the cameras that
  // the model lists. It has only a few images, unless the user chose their number or `video` is set.
  void look_around(bool video);
  bool wanted() const { return !path_.empty() || holds(); }
  // Returns whether the camera stays at one view of the data instead of following a path.
  bool holds() const { return hold_ >= 0; }
  // Returns the fixed time if --time states one. Throws Error(usage) for a range.
  std::optional<double> single_time(const MixedModel& model) const;
  double fps() const { return fps_; }
  // Returns the size that the user chose with --size.
  std::optional<ImageSize> size() const;
  // Throws Error(usage) if an option of paths is given without --path. --time is always allowed,
  // --path-frames is allowed with --hold, and --size is allowed if `sized` is set.
  void check_unused(bool sized = false) const;
  // Returns the views frame_0000, ... in the coordinates of the model. `cameras` are those of the data and
  // may be empty. If `even` is set, an image size that the user did not choose is rounded down to even
  // numbers.
  Split views(const LoadedModel& model, std::span<const Camera> cameras, bool even) const;

 private:
  // Throws Error(usage) for options that only apply to orbits and spirals.
  void check_no_turn() const;
  Canvas canvas(std::span<const Camera> cameras, bool even) const;
  FrameHints hints(const LoadedModel& model, double fov) const;
  std::unique_ptr<CameraPath> path(const LoadedModel& model, std::span<const Camera> cameras,
                                   const SceneFrame& frame, double fov) const;
  std::vector<double> time_range(const MixedModel& model) const;
  void set_times(std::vector<Pose>& poses, bool from_path, const MixedModel& model) const;
  Split held(const MixedModel& model, std::span<const Camera> cameras) const;

  std::string path_, size_, time_, centre_, up_;
  int frames_ = 120, hold_ = -1;
  double fps_ = 30, fov_ = 0, loops_ = 1, distance_ = 0, elevation_ = 0;
  std::vector<CLI::Option*> options_, turning_;
  CLI::Option *elevation_option_ = nullptr, *frames_option_ = nullptr, *up_option_ = nullptr,
              *size_option_ = nullptr;
};

}  // namespace ubs::tools
