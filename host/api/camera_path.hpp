// SPDX-License-Identifier: Apache-2.0
// Camera paths as functions of u in [0, 1]: the pose at each moment of a video. Closed paths end where they
// begin (u = 1 is u = 0).
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
  virtual bool has_time() const { return false; }  // whether Pose::time means something
};

// Around the centre at constant distance and elevation, `loops` times (not 0; negative: the other way).
std::unique_ptr<CameraPath> orbit_path(const SceneFrame& frame, double fov, double loops);

// Around the mean pose, always looking at the point at its focus depth: for scenes that were photographed
// from one side. Moves sideways by the spread of the cameras and, once, forth and back by a third of it.
std::unique_ptr<CameraPath> spiral_path(const SceneFrame& frame, double fov, double loops);

// Through poses at equal intervals of u: uniform Catmull-Rom splines for positions (smooth velocity), slerp
// for rotations, straight lines for angle of view and time. At least one pose; `closed` returns to the first.
std::unique_ptr<CameraPath> keyframe_path(std::vector<Pose> keyframes, bool closed, bool has_time);

// Along a dozen of these cameras, evenly chosen: in their order where that is a walk, else from each to the
// nearest that is left. At least one camera.
std::unique_ptr<CameraPath> walk_path(std::span<const Camera> cameras, double fov);

// u of each of `frames` pictures: evenly from 0 to 1, for closed paths without the end, which is the
// beginning.
std::vector<double> path_moments(int frames, bool closed);

}  // namespace ubs
