// SPDX-License-Identifier: Apache-2.0
// CameraPath is a function of u in [0, 1]: it gives the camera pose at each moment of a video. Closed paths
// end where they begin (u = 1 is u = 0).
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "host/api/scene_frame.hpp"
#include "host/scene/pose.hpp"

namespace ubs {

class CameraPath {
 public:
  virtual ~CameraPath() = default;
  virtual Pose at(double u) const = 0;
  virtual bool closed() const = 0;
  virtual bool has_time() const { return false; }  // whether Pose::time has a meaning
};

// Returns a path at constant distance and elevation that goes around the centre `loops` times (not 0;
// negative: in the opposite direction).
std::unique_ptr<CameraPath> orbit_path(const SceneFrame& frame, double fov, double loops);

// Returns a path for scenes that were photographed from one side. It circles around the mean position `loops`
// times, with the spread of the cameras as its radius, and moves forward and backward once, by a third of the
// spread. The camera always looks at the point at the focus depth of the mean pose.
std::unique_ptr<CameraPath> spiral_path(const SceneFrame& frame, double fov, double loops);

// Returns a path through poses at equal intervals of u. Positions follow uniform Catmull-Rom splines (with
// continuous velocity), rotations are interpolated by slerp, and angle of view and time change linearly.
// Needs at least one pose. If `closed` is set, the path returns to the first pose.
std::unique_ptr<CameraPath> keyframe_path(std::vector<Pose> keyframes, bool closed, bool has_time);

// Returns a path along a dozen of the cameras, evenly chosen. The path keeps their order, unless that makes
// it much longer than going from each camera to the nearest remaining one; in that case it does the latter.
// Needs at least one camera.
std::unique_ptr<CameraPath> walk_path(std::span<const Camera> cameras, double fov);

// Returns the value of u for each of `frames` images, evenly spaced from 0 to 1. Closed paths leave out the
// end, because it equals the beginning.
std::vector<double> path_moments(int frames, bool closed);

}  // namespace ubs
