// SPDX-License-Identifier: Apache-2.0
// See camera.hpp.
#include "host/scene/camera.hpp"

namespace ubs {

std::array<double, 3> Camera::centre() const {
  std::array<double, 3> c{};
  for (int row = 0; row < 3; ++row)
    for (int col = 0; col < 3; ++col) c[col] -= rotation[3 * row + col] * translation[row];
  return c;
}

}  // namespace ubs
