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

// Returns a path around the centre at constant distance and elevation, `loops` times (not 0; negative: in the
// opposite direction).
std::unique_ptr<CameraPath> orbit_path(const SceneFrame& frame, double fov, double loops);

// Returns a path around the mean pose, always looking at the point at its focus depth, for scenes that were
// photographed from one side. It moves sideways by the spread of the cameras and, once, forward and backward
// by a third of the spread.
std::unique_ptr<CameraPath> spiral_path(const SceneFrame& frame, double fov, double loops);

// Returns a path through poses at equal intervals of u. Positions follow uniform Catmull-Rom splines (with
// continuous velocity), rotations slerp, and angle of view and time change linearly. Needs at least one pose.
// If `closed` is set, the path returns to the first pose.
std::unique_ptr<CameraPath> keyframe_path(std::vector<Pose> keyframes, bool closed, bool has_time);

// Returns a path along a dozen of the cameras, evenly chosen. It keeps their order if that is a walk;
// otherwise it goes from each to the nearest remaining one. Needs at least one camera.
std::unique_ptr<CameraPath> walk_path(std::span<const Camera> cameras, double fov);

// Returns the u of each of `frames` images, evenly spaced from 0 to 1. Closed paths leave out the end,
// because it equals the beginning.
std::vector<double> path_moments(int frames, bool closed);

}  // namespace ubs
