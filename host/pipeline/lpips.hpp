// SPDX-License-Identifier: Apache-2.0
// LPIPS (version 0.1) of two images on a device: convolutions as matrix products, layer by layer for both
// images, so that only two layers' features of each are held. The matrices are made for as many output
// pixels at a time as the back end asks for, which bounds memory at any image size.
#pragma once

#include <array>
#include <map>

#include "host/pipeline/network.hpp"
#include "host/pipeline/safetensors.hpp"

namespace ubs {

// What the network is fed: 2 v - 1, as LPIPS is defined, or v itself, as the published evaluation of splats
// does (method.md 4.7). The distances differ; compare like with like.
enum class LpipsRange { signed_one, unit };

struct LpipsMemory {  // bytes
  std::uint64_t weights = 0, features = 0, matrix = 0, product = 0, distances = 0;
  std::uint64_t total() const { return weights + features + matrix + product + distances; }
};

class Lpips {
 public:
  // Uploads the weights; throws Error(data) naming file and tensor when they do not form this network.
  Lpips(Device& device, MetricOps& ops, const Network& network, const TensorFile& weights);

  const Network& network() const { return *network_; }
  // Throws Error(data) when an image is smaller than the network can take, or not the size of the other one;
  // Error(numerical) when the distance is not finite. Waits.
  double distance(const DeviceImage& a, const DeviceImage& b, LpipsRange range);
  // Throws as distance() does.
  void check_size(PlanarSize size) const;
  // Device memory once images of this size have been compared (and no larger ones).
  LpipsMemory memory(PlanarSize size) const;

 private:
  struct Convolution {
    Layer layer;
    int out = 0, in = 0;
    Buffer<float> weight, bias;
  };
  struct Stage {  // of the network with its weights
    Layer layer;
    std::vector<Convolution> convolutions;  // one; fire: squeeze, expand1x1, expand3x3; else none
    Buffer<float> head;                     // tap
    int channels = 0;                       // after it
  };
  // Floats of the buffers for images of a size.
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
  std::array<std::array<Buffer<float>, 2>, 2> features_;  // [image][layers alternate]
  Buffer<float> squeezed_, matrix_, distances_, sums_;
};

}  // namespace ubs
