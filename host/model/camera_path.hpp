// SPDX-License-Identifier: Apache-2.0
// CameraPath is the path of the camera in a video. It returns the camera pose for each value of u, which goes
// from 0 at the start of the video to 1 at its end. In a closed path, u = 0 and u = 1 have the same pose.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "host/model/scene_frame.hpp"
#include "host/scene/pose.hpp"

namespace ubs {

class CameraPath {
 public:
  virtual ~CameraPath() = default;
  virtual Pose at(double u) const = 0;
  virtual bool closed() const = 0;
  // Returns whether the path determines the time. If it does not, Pose::time of the returned poses is unused.
  virtual bool has_time() const { return false; }
};

// Returns a path at constant distance and elevation that goes around the centre of the scene `loops` times.
// `loops` must not be 0; if it is negative, the camera moves in the opposite direction. `fov` is the
// horizontal angle of view [rad].
std::unique_ptr<CameraPath> orbit_path(const SceneFrame& frame, double fov, double loops);

// Returns a path for scenes that were photographed from one side. It circles around the mean position of the
// cameras `loops` times, with the radius SceneFrame::spread, and moves forward and backward once, by a third
// of this radius. The camera always looks at the point that is in front of the mean pose, at the depth
// SceneFrame::focus.
std::unique_ptr<CameraPath> spiral_path(const SceneFrame& frame, double fov, double loops);

// Returns a path through poses at equal intervals of u. Positions follow uniform Catmull-Rom splines (with
// continuous velocity), rotations are interpolated by slerp, and angle of view and time change linearly.
// Needs at least one pose. If `closed` is set, the path returns to the first pose.
std::unique_ptr<CameraPath> keyframe_path(std::vector<Pose> keyframes, bool closed, bool has_time);

// Returns a path through at most twelve of the cameras, chosen at even intervals. The path keeps the order of
// the cameras, unless this makes it more than 1.5 times as long as the path that goes from each camera to the
// nearest remaining one. In this case, the function returns the shorter path. Needs at least one camera.
std::unique_ptr<CameraPath> walk_path(std::span<const Camera> cameras, double fov);

// Returns the value of u for each of `frames` images, evenly spaced from 0 to 1. For closed paths the value 1
// is omitted, because its pose is that of the value 0.
std::vector<double> path_moments(int frames, bool closed);

}  // namespace ubs
