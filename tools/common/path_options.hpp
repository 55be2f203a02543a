// SPDX-License-Identifier: Apache-2.0
// The options of a camera path, and the views along it: what `ubs render --path` draws in the place of the
// views of a data folder.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

#include "host/api/camera_path.hpp"
#include "host/data/image.hpp"
#include "host/data/splat_file.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::tools {

// "640x480". Throws Error(usage) for other texts and sizes outside 1 to 16384.
ImageSize parse_size(const std::string& option, const std::string& text);
// "1,-2.5,0", or an axis: "x", "-y". Throws Error(usage) otherwise.
Vec3 parse_vector(const std::string& option, const std::string& text);

inline constexpr const char* kUpHelp =
    "up direction of the scene: a vector, or an axis such as -y [mean of the cameras of the data, otherwise "
    "away from a floor, otherwise -y for third-party files and z for ubs files]";
// What the format says about a scene: files of other tools have the y of their cameras, which points down.
FrameHints frame_hints(const LoadedModel& model);

class PathOptions {
 public:
  explicit PathOptions(CLI::App& app);
  PathOptions(const PathOptions&) = delete;

  // For a model without data: a path that suits its cameras unless one is given, of few pictures unless their
  // number is given.
  void look_around(bool video);
  bool wanted() const { return !path_.empty() || holds(); }
  bool holds() const { return hold_ >= 0; }  // one view of the data, in the place of a path
  // The fixed time, where --time gives one and there is no path. Throws Error(usage) for a range.
  std::optional<double> single_time(const MixedModel& model) const;
  double fps() const { return fps_; }
  // The size that was asked for.
  std::optional<ImageSize> size() const;
  // Throws Error(usage) when one of the other options, but for --time, is given without --path (with --hold:
  // but for --path-frames too). `sized`: --size has a use without a path.
  void check_unused(bool sized = false) const;
  // Views frame_0000, ... in the coordinates of the model. `cameras`: of the data, may be empty. `even`: a
  // size that was not asked for is rounded down to even numbers.
  Split views(const LoadedModel& model, std::span<const Camera> cameras, bool even) const;

 private:
  // Throws Error(usage) for an option that neither a walk nor keyframes use.
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
