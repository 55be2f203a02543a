// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/camera_gradient.hpp"

namespace ubs {

std::array<double, 12> matrix_gradient(const CameraGradient& gradient, const Camera& camera) {
  const std::array<double, 3>&t = camera.translation, &u = gradient.shift;
  std::array<double, 3> a = gradient.turn;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    a[i] -= t[j] * u[k] - t[k] * u[j];
  }
  std::array<double, 12> out{};
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    for (std::size_t c = 0; c < 3; ++c)
      out[4 * i + c] = 0.5 * (a[j] * camera.rotation[3 * k + c] - a[k] * camera.rotation[3 * j + c]);
    out[4 * i + 3] = u[i];
  }
  return out;
}

}  // namespace ubs
