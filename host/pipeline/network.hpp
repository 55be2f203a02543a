// SPDX-License-Identifier: Apache-2.0
// The networks of LPIPS as data: their layers in order, as torchvision has them up to the last tap. Numbers
// of channels come from the weights; tensors carry torchvision's names ("features.3.weight"), those of the
// linear heads are lin0.weight, lin1.weight, ...
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/device/metric_ops.hpp"

namespace ubs {

enum class LayerKind {
  convolution,  // with bias and ReLU
  fire,         // SqueezeNet: 1x1 to few channels, then 1x1 and 3x3 side by side; ReLU after each
  pool,         // maximum
  tap           // the features so far are compared
};

struct Layer {
  LayerKind kind;
  int number = 0;  // of the module in `features`
  int window = 1, stride = 1, padding = 0;
  bool ceil = false;  // pool: a last window that is not full counts
};

struct Network {
  std::string_view name;  // "alex"
  std::vector<Layer> layers;
};

// alex, squeeze, vgg.
const std::vector<Network>& lpips_networks();
// Throws Error(usage) listing the names.
const Network& lpips_network(std::string_view name);

// Of the output of a convolution or pool; 0 or less where the input is smaller than the window.
PlanarSize output_size(const Layer& layer, PlanarSize size);
// Smallest side of an image with at least one pixel at every tap.
int smallest_side(const Network& network);

}  // namespace ubs
