// SPDX-License-Identifier: Apache-2.0
// Network describes one of the networks of LPIPS as a list of layers, in the order of torchvision. The list
// contains additional entries, called taps, at the places where LPIPS compares features, and it ends with the
// last tap. The numbers of channels come from the weights. The tensors of a weight file have the names of
// torchvision, for example "features.3.weight". The weights of the taps are called lin0.weight, lin1.weight,
// and so on.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/device/metric_ops.hpp"

namespace ubs {

enum class LayerKind {
  convolution,  // a convolution with bias, followed by a ReLU
  // A module of SqueezeNet: a 1x1 convolution to fewer channels, and then a 1x1 and a 3x3 convolution of its
  // result, whose outputs are concatenated. A ReLU follows each convolution.
  fire,
  pool,  // maximum pooling
  tap    // no operation: LPIPS compares the features of the previous layer
};

struct Layer {
  LayerKind kind;
  int number = 0;  // number of the module in torchvision's `features`, for the names of its tensors
  int window = 1, stride = 1, padding = 0;
  bool ceil = false;  // only for pool: incomplete windows at the right and bottom edge are included
};

struct Network {
  std::string_view name;  // "alex", "squeeze" or "vgg"
  std::vector<Layer> layers;
};

// Returns the networks alex, squeeze and vgg.
const std::vector<Network>& lpips_networks();
// Returns the network with this name. Throws Error(usage) with the list of valid names if there is none.
const Network& lpips_network(std::string_view name);

// Returns the size of the output of a layer. A side of the output is 0 if that side of the padded input is
// smaller than the window.
PlanarSize output_size(const Layer& layer, PlanarSize size);
// Returns the side of the smallest square image whose features have at least one pixel at every tap.
int smallest_side(const Network& network);

}  // namespace ubs
