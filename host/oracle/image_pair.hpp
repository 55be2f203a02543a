// SPDX-License-Identifier: Apache-2.0
// Pairs of random images to compare by metrics: as bytes, as doubles for references, and on a device in both
// of the layouts that metrics read.
#pragma once

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "host/oracle/lpips.hpp"

namespace ubs::oracle {

inline std::vector<std::uint8_t> random_bytes(PlanarSize size, unsigned seed) {
  std::mt19937 generator(seed);
  std::vector<std::uint8_t> bytes(3 * size.pixels());
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(generator());
  return bytes;
}

// Neighbouring pixels alike, a second image a little different: as images are.
inline std::array<std::vector<std::uint8_t>, 2> image_pair(PlanarSize size) {
  std::array<std::vector<std::uint8_t>, 2> pair{random_bytes(size, 1), {}};
  for (std::size_t i = 1; i < pair[0].size(); ++i)
    pair[0][i] = static_cast<std::uint8_t>((7 * pair[0][i - 1] + pair[0][i]) / 8);
  pair[1] = pair[0];
  const std::vector<std::uint8_t> noise = random_bytes(size, 2);
  for (std::size_t i = 0; i < pair[1].size(); ++i)
    pair[1][i] = static_cast<std::uint8_t>((3 * pair[1][i] + noise[i]) / 4);
  return pair;
}

inline Features features(const std::vector<std::uint8_t>& bytes, PlanarSize size) {
  Features f(3, size);
  for (std::size_t i = 0; i < bytes.size(); ++i) f.values[i] = bytes[i] / 255.0;
  return f;
}

struct Uploaded {  // one image as 8 bit, one as padded float planes
  Buffer<std::uint8_t> bytes;
  Buffer<float> values;
  DeviceImage a, b;
};

inline Uploaded upload(Device& device, const std::array<std::vector<std::uint8_t>, 2>& pair,
                       PlanarSize size) {
  const int pitch = size.width + 5, rows = size.height + 3;
  std::vector<float> values(3ull * static_cast<std::size_t>(pitch) * static_cast<std::size_t>(rows), NAN);
  for (std::size_t i = 0; i < pair[1].size(); ++i) {
    const std::size_t c = i / size.pixels(), y = i % size.pixels() / size.width, x = i % size.width;
    values[(c * rows + y) * pitch + x] = static_cast<float>(pair[1][i]) / 255.0f;
  }
  Uploaded up{{device, "image", pair[0].size()}, {device, "image", values.size()}, {}, {}};
  up.bytes.upload(pair[0]);
  up.values.upload(values);
  up.a = {.size = size, .bytes = up.bytes.view()};
  up.b = {.size = size, .values = up.values.view(), .pitch = pitch, .rows = rows};
  return up;
}

}  // namespace ubs::oracle
