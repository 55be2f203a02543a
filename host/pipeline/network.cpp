// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/network.hpp"

#include <algorithm>

#include "host/base/error.hpp"

namespace ubs {
namespace {

Layer convolution(int number, int window, int stride, int padding) {
  return {LayerKind::convolution, number, window, stride, padding};
}
Layer fire(int number) { return {LayerKind::fire, number}; }
Layer pool(int window, int stride, bool ceil) { return {LayerKind::pool, 0, window, stride, 0, ceil}; }
const Layer kTap{LayerKind::tap};

Network alex() {
  return {
      "alex",
      {convolution(0, 11, 4, 2), kTap, pool(3, 2, false), convolution(3, 5, 1, 2), kTap, pool(3, 2, false),
       convolution(6, 3, 1, 1), kTap, convolution(8, 3, 1, 1), kTap, convolution(10, 3, 1, 1), kTap}};
}

Network squeeze() {  // SqueezeNet 1.1
  return {"squeeze",
          {convolution(0, 3, 2, 0), kTap, pool(3, 2, true), fire(3), fire(4), kTap, pool(3, 2, true), fire(6),
           fire(7), kTap, pool(3, 2, true), fire(9), kTap, fire(10), kTap, fire(11), kTap, fire(12), kTap}};
}

Network vgg() {  // VGG-16
  Network network{"vgg", {}};
  const std::vector<std::vector<int>> blocks{{0, 2}, {5, 7}, {10, 12, 14}, {17, 19, 21}, {24, 26, 28}};
  for (const std::vector<int>& block : blocks) {
    if (!network.layers.empty()) network.layers.push_back(pool(2, 2, false));
    for (const int number : block) network.layers.push_back(convolution(number, 3, 1, 1));
    network.layers.push_back(kTap);
  }
  return network;
}

int output_length(const Layer& layer, int length) {
  const int room = length + 2 * layer.padding - layer.window;
  if (room < 0) return 0;
  return (room + (layer.ceil ? layer.stride - 1 : 0)) / layer.stride + 1;
}

}  // namespace

const std::vector<Network>& lpips_networks() {
  static const std::vector<Network> networks{alex(), squeeze(), vgg()};
  return networks;
}

const Network& lpips_network(std::string_view name) {
  const auto found = std::ranges::find(lpips_networks(), name, &Network::name);
  if (found == lpips_networks().end())
    fail(ErrorKind::usage, "unknown LPIPS network '{}': expected alex, squeeze or vgg", name);
  return *found;
}

PlanarSize output_size(const Layer& layer, PlanarSize size) {
  if (layer.kind == LayerKind::fire || layer.kind == LayerKind::tap) return size;
  return {output_length(layer, size.width), output_length(layer, size.height)};
}

int smallest_side(const Network& network) {
  for (int side = 1;; ++side) {
    PlanarSize size{side, side};
    for (const Layer& layer : network.layers)
      if (size.width > 0) size = output_size(layer, size);
    if (size.width > 0) return side;
  }
}

}  // namespace ubs
