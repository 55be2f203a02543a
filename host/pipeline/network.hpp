// SPDX-License-Identifier: Apache-2.0
// Network describes a network of LPIPS as data: its layers in the order of torchvision, up to the last tap.
// The numbers of channels come from the weights. Tensors have torchvision's names ("features.3.weight"), and
// those of the linear heads are lin0.weight, lin1.weight, ...
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/device/metric_ops.hpp"

namespace ubs {

enum class LayerKind {
  convolution,  // with bias and ReLU
  fire,         // SqueezeNet: 1x1 to few channels, then 1x1 and 3x3 side by side; ReLU after each
  pool,         // maximum pooling
  tap           // the features at this point are compared
};

struct Layer {
  LayerKind kind;
  int number = 0;  // number of the module in `features`
  int window = 1, stride = 1, padding = 0;
  bool ceil = false;  // pool: an incomplete window at the edge counts
};

struct Network {
  std::string_view name;  // "alex"
  std::vector<Layer> layers;
};

// Returns the networks alex, squeeze and vgg.
const std::vector<Network>& lpips_networks();
// Returns the network with this name. Throws Error(usage) with the list of valid names if there is none.
const Network& lpips_network(std::string_view name);

// Returns the size of the output of a convolution or pool. It is 0 or less if the input is smaller than the
// window.
PlanarSize output_size(const Layer& layer, PlanarSize size);
// Returns the smallest side of an image that has at least one pixel at every tap.
int smallest_side(const Network& network);

}  // namespace ubs
