// SPDX-License-Identifier: Apache-2.0
// A pinhole camera in COLMAP axes (x right, y down, z forward) and the query values of its frame.
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
  double time = 0;            // normalised over the training frames (method.md 4.6)
  std::vector<double> extra;  // further query values after time, for N > 7

  bool operator==(const Camera&) const = default;

  std::array<double, 3> centre() const;  // camera position in the world, -R^T t
  // Of a place in the image, in the world; where the point of depth d stands: centre() + d ray.
  std::array<double, 3> ray(double column, double row) const;
};

// Focal lengths and principal point.
inline void take_lens(Camera& to, const Camera& from) {
  to.fx = from.fx, to.fy = from.fy, to.cx = from.cx, to.cy = from.cy;
}

// At most so many of them, evenly spaced, the first among them.
std::vector<Camera> evenly_chosen(std::span<const Camera> cameras, std::size_t most);

// Numbers from files: products of two are finite in float32, and so are they less an offset.
inline constexpr double kMaxMagnitude = 1e15;
inline constexpr double kMinFocal = 1e-6;  // [px]
inline constexpr int kMaxPixelsAcross = 65535;
inline constexpr std::int64_t kMaxPixels = 1 << 29;  // kernels count those of three channels in 31 bits

// `value` itself; Error(data) that starts with `what` when it is not finite or beyond kMaxMagnitude.
double checked_input(double value, const std::string& what);
// Error(data) that starts with `what` for scale, shear, mirroring and NaN; row-major.
void check_rotation(const std::array<double, 9>& rotation, const std::string& what);
// Every loader has its cameras checked here: orientation, magnitudes, focal lengths, size. Error(data) that
// starts with `where`, the file and the frame.
void check_camera(const Camera& camera, const std::string& where);

}  // namespace ubs
