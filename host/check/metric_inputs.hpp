// SPDX-License-Identifier: Apache-2.0
// The device check and tests use these functions to create inputs of the image metrics: pairs of random
// images, in host memory and on a device, and random weights of small networks.
#pragma once

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "host/pipeline/image_metrics.hpp"
#include "host/pipeline/lpips.hpp"
#include "host/pipeline/safetensors.hpp"

namespace ubs::check {

inline std::vector<std::uint8_t> random_bytes(PlanarSize size, unsigned seed) {
  std::mt19937 generator(seed);
  std::vector<std::uint8_t> bytes(3 * size.pixels());
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(generator());
  return bytes;
}

// Returns two images that resemble photographs in two respects: neighbouring pixels are similar, and the
// second image differs only slightly from the first.
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

// Uploaded holds the two images of a pair in the two layouts that metrics can read: `a` as 8-bit values, and
// `b` as float planes with padding.
struct Uploaded {
  Buffer<std::uint8_t> bytes;
  Buffer<float> values;
  DeviceImage a, b;
};

// Uploads a pair of images. The padding is NaN, so that a metric that reads the padding gives a wrong result.
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

// Returns random weights for a network. The network gets few channels. The weights are such that after each
// ReLU about half of the features are positive.
inline TensorFile random_weights(const Network& network, unsigned seed) {
  TensorFile file{"random", {}};
  std::mt19937 generator(seed);
  const auto fill = [&](const std::string& name, std::vector<std::size_t> shape, float low, float high) {
    Tensor tensor{std::move(shape), {}};
    std::size_t count = 1;
    for (const std::size_t extent : tensor.shape) count *= extent;
    std::uniform_real_distribution<float> value(low, high);
    for (std::size_t i = 0; i < count; ++i) tensor.values.push_back(value(generator));
    file.tensors[name] = std::move(tensor);
  };
  std::size_t channels = 3, next = 5;  // odd, because kernels must not rely on multiples of 4
  const auto convolution = [&](const std::string& name, std::size_t in, std::size_t out, std::size_t window) {
    const float limit = std::sqrt(6.0f / static_cast<float>(in * window * window));
    fill(name + ".weight", {out, in, window, window}, -limit, limit);
    fill(name + ".bias", {out}, -0.1f, 0.1f);
  };
  int taps = 0;
  for (const Layer& layer : network.layers) {
    const std::string name = fmt::format("features.{}", layer.number);
    if (layer.kind == LayerKind::convolution) {
      convolution(name, channels, next, static_cast<std::size_t>(layer.window));
      channels = next;
      next += 2;
    } else if (layer.kind == LayerKind::fire) {
      convolution(name + ".squeeze", channels, 3, 1);
      convolution(name + ".expand1x1", 3, next, 1);
      convolution(name + ".expand3x3", 3, next + 1, 3);
      channels = 2 * next + 1;
    } else if (layer.kind == LayerKind::tap) {
      fill(fmt::format("lin{}.weight", taps++), {1, channels, 1, 1}, 0.0f, 1.0f);
    }
  }
  return file;
}

}  // namespace ubs::check
