// SPDX-License-Identifier: Apache-2.0
// Camera is a pinhole camera with the axes of COLMAP (x right, y down, z forward). It also contains the time
// of its image and further query values, on which splats with N > 3 can depend.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace ubs {

struct Camera {
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  // world -> camera, row-major
  std::array<double, 3> translation{0, 0, 0};                 // p_cam = rotation * p_world + translation
  double fx = 1, fy = 1;                                      // focal lengths [px]
  double cx = 0, cy = 0;  // principal point [px]; the centre of pixel (0,0) is (0.5, 0.5)
  int width = 0, height = 0;
  double time = 0;            // normalised to the times of the training images (method.md 4.6)
  std::vector<double> extra;  // further query values after time, for N = 5 and N > 7

  bool operator==(const Camera&) const = default;

  std::array<double, 3> centre() const;  // camera position in the world, -R^T t
  // Returns the direction of the ray through a position in the image, in world coordinates. The length is
  // chosen so that centre() + d ray is the point with depth d.
  std::array<double, 3> ray(double column, double row) const;
};

// Copies the focal lengths and the principal point.
inline void copy_intrinsics(Camera& to, const Camera& from) {
  to.fx = from.fx, to.fy = from.fy, to.cx = from.cx, to.cy = from.cy;
}

// Returns at most `most` of the cameras. Their indices are evenly spaced and start at 0.
std::vector<Camera> evenly_chosen(std::span<const Camera> cameras, std::size_t most);

// Limits for the numbers of a camera that is read from a file. The product of two numbers within
// kMaxMagnitude is finite in float32, even if an offset was subtracted from them before.
inline constexpr double kMaxMagnitude = 1e15;
inline constexpr double kMinFocal = 1e-6;  // [px]
inline constexpr int kMaxPixelsAcross = 65535;
// Kernels use 31-bit indices for the values of an image, which has three channels.
inline constexpr std::int64_t kMaxPixels = 1 << 29;

// Returns `value`. Throws Error(data) with a message that starts with `what` if it is not finite or exceeds
// kMaxMagnitude.
double checked_input(double value, const std::string& what);
// If the row-major matrix was rounded so coarsely, for example to three decimal places, that check_rotation()
// would refuse it, replaces it by the nearest rotation and returns true. Other matrices stay unchanged.
bool settle_rotation(std::array<double, 9>& rotation);
// Throws Error(data) with a message that starts with `what` if the row-major matrix is not a rotation,
// because of scale, shear, mirroring or NaN.
void check_rotation(const std::array<double, 9>& rotation, const std::string& what);
// Checks the orientation, magnitudes, focal lengths and image size of a camera. Every loader calls this.
// Throws Error(data) with a message that starts with `where`, which contains the file and the frame.
void check_camera(const Camera& camera, const std::string& where);

}  // namespace ubs
