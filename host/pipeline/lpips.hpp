// SPDX-License-Identifier: Apache-2.0
// Lpips computes the LPIPS distance (version 0.1) of two images on a device. Convolutions are computed as
// matrix products. Both images go through the network layer by layer, so that only the features of two layers
// are stored for each image. A convolution of many pixels is split into several matrix products. The back end
// determines the maximum size of their matrices (MetricOps::matrix_bytes()), which limits the memory for
// large images.
#pragma once

#include <array>
#include <map>

#include "host/pipeline/network.hpp"
#include "host/pipeline/safetensors.hpp"

namespace ubs {

// LpipsRange is the range of values to which an image v in [0, 1] is converted before the network processes
// it. `signed_one` converts to 2 v - 1, as in the definition of LPIPS. `unit` does not convert, as in the
// published evaluation of splats (method.md 4.7). The distances differ, so only distances of the same range
// can be compared.
enum class LpipsRange { signed_one, unit };

struct LpipsMemory {  // bytes
  std::uint64_t weights = 0, features = 0, matrix = 0, product = 0, distances = 0;
  std::uint64_t total() const { return weights + features + matrix + product + distances; }
};

class Lpips {
 public:
  // Uploads the weights. Throws Error(data) with the file and the tensor if they do not match this network.
  Lpips(Device& device, MetricOps& ops, const Network& network, const TensorFile& weights);

  const Network& network() const { return *network_; }
  // Waits for the device and returns the distance. Throws Error(data) if an image is too small for the
  // network or the sizes differ, and Error(numerical) if the distance is not finite.
  double distance(const DeviceImage& a, const DeviceImage& b, LpipsRange range);
  // Throws Error(data) if images of this size are too small for the network.
  void check_size(PlanarSize size) const;
  // Returns the device memory that this object uses after it has compared images of this size and no larger
  // images.
  LpipsMemory memory(PlanarSize size) const;

 private:
  struct Convolution {
    Layer layer;
    int out = 0, in = 0;
    Buffer<float> weight, bias;
  };
  struct Stage {  // a layer of the network with its weights
    Layer layer;
    // The convolutions of the layer. A convolutional layer has one, a fire module has three (squeeze,
    // expand1x1, expand3x3), and other layers have none.
    std::vector<Convolution> convolutions;
    Buffer<float> head;  // weights of the channels in the distance; only layers that are compared have them
    int channels = 0;    // number of channels after this layer
  };
  // Need contains the sizes of the buffers for images of a given size, in floats except for product_bytes.
  struct Need {
    std::array<std::size_t, 2> features{0, 0};
    std::size_t squeezed = 0, matrix = 0, product_bytes = 0, plane = 0;
  };

  Convolution load(const TensorFile& file, const std::string& name, const Layer& layer, int in);
  Buffer<float> upload(const Tensor& tensor, const char* label);
  Stage load_stage(const TensorFile& file, const Layer& layer, int channels, int& taps);
  int columns_at_once(const Convolution& convolution, const PlanarSize& out) const;
  bool is_product(const Convolution& convolution) const;
  MatrixProduct product(const Convolution& convolution, const PlanarSize& out) const;
  void add_need(const Convolution& convolution, const PlanarSize& size, Need& need) const;
  Need need(PlanarSize size) const;
  void reserve(const Need& need);
  void load_image(const DeviceImage& image, LpipsRange range, BufferView<float> to);
  void convolve(const Convolution& convolution, BufferView<float> image, PlanarSize size,
                BufferView<float> to, int first_channel);
  void run(const Stage& stage, BufferView<float> image, PlanarSize size, int channels, BufferView<float> to);

  Device& device_;
  MetricOps& ops_;
  const Network* network_;
  std::vector<Stage> stages_;
  int taps_ = 0;
  std::array<std::array<Buffer<float>, 2>, 2> features_;  // [image][layer number modulo 2]
  Buffer<float> squeezed_, matrix_, distances_, sums_;
};

}  // namespace ubs
