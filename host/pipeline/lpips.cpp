// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/lpips.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"

namespace ubs {
namespace {

// These are the shift and the scale of the input per channel, from the definition of LPIPS.
constexpr std::array<double, 3> kShift{-0.030, -0.088, -0.188}, kScale{0.458, 0.448, 0.450};
constexpr Layer kPointwise{LayerKind::convolution, 0, 1, 1, 0},
    kThreeByThree{LayerKind::convolution, 0, 3, 1, 1};

std::string shape_text(const Tensor& tensor) { return fmt::format("({})", fmt::join(tensor.shape, ", ")); }

void grow(Device& device, Buffer<float>& buffer, const char* label, std::size_t floats) {
  if (buffer && buffer.size() >= floats) return;
  buffer = {};  // release the old buffer before the larger one is allocated
  buffer = Buffer<float>(device, label, floats);
}

}  // namespace

Lpips::Lpips(Device& device, MetricOps& ops, const Network& network, const TensorFile& weights)
    : device_(device), ops_(ops), network_(&network) {
  int channels = 3;
  for (const Layer& layer : network.layers) {
    stages_.push_back(load_stage(weights, layer, channels, taps_));
    channels = stages_.back().channels;
  }
  sums_ = Buffer<float>(device, "LPIPS sums", static_cast<std::size_t>(taps_ * kPartialSums));
}

Buffer<float> Lpips::upload(const Tensor& tensor, const char* label) {
  Buffer<float> buffer(device_, label, tensor.values.size());
  buffer.upload(tensor.values);
  return buffer;
}

Lpips::Convolution Lpips::load(const TensorFile& file, const std::string& name, const Layer& layer, int in) {
  const Tensor &weight = file.at(name + ".weight"), &bias = file.at(name + ".bias");
  const auto window = static_cast<std::size_t>(layer.window);
  const std::size_t out = weight.shape.empty() ? 0 : weight.shape[0];
  if (out == 0 ||
      weight.shape != std::vector<std::size_t>{out, static_cast<std::size_t>(in), window, window} ||
      bias.shape != std::vector<std::size_t>{out})
    fail(ErrorKind::data,
         "{}: '{}' has weights {} and bias {}, but the network '{}' needs (n, {}, {}, {}) and (n)",
         file.path.string(), name, shape_text(weight), shape_text(bias), network_->name, in, window, window);
  return {layer, static_cast<int>(out), in, upload(weight, "network weights"),
          upload(bias, "network weights")};
}

Lpips::Stage Lpips::load_stage(const TensorFile& file, const Layer& layer, int channels, int& taps) {
  Stage stage{layer, {}, {}, channels};
  const std::string name = fmt::format("features.{}", layer.number);
  if (layer.kind == LayerKind::convolution) {
    stage.convolutions.push_back(load(file, name, layer, channels));
    stage.channels = stage.convolutions[0].out;
  } else if (layer.kind == LayerKind::fire) {
    stage.convolutions.push_back(load(file, name + ".squeeze", kPointwise, channels));
    const int squeezed = stage.convolutions[0].out;
    stage.convolutions.push_back(load(file, name + ".expand1x1", kPointwise, squeezed));
    stage.convolutions.push_back(load(file, name + ".expand3x3", kThreeByThree, squeezed));
    stage.channels = stage.convolutions[1].out + stage.convolutions[2].out;
  } else if (layer.kind == LayerKind::tap) {
    const std::string head = fmt::format("lin{}.weight", taps++);
    const Tensor& weight = file.at(head);
    if (weight.shape != std::vector<std::size_t>{1, static_cast<std::size_t>(channels), 1, 1})
      fail(ErrorKind::data, "{}: '{}' has shape {}, but the network '{}' needs (1, {}, 1, 1)",
           file.path.string(), head, shape_text(weight), network_->name, channels);
    stage.head = upload(weight, "network weights");
  }
  return stage;
}

void Lpips::check_size(PlanarSize size) const {
  const int least = smallest_side(*network_);
  if (size.width < least || size.height < least)
    fail(ErrorKind::data,
         "LPIPS with '{}' needs images of at least {} x {} pixels, but this image has {} x {}",
         network_->name, least, least, size.width, size.height);
}

// Returns whether a convolution is a matrix product already, because its window is a single pixel and its
// stride is 1.
bool Lpips::is_product(const Convolution& convolution) const {
  return convolution.layer.window == 1 && convolution.layer.stride == 1;
}

int Lpips::columns_at_once(const Convolution& convolution, const PlanarSize& out) const {
  const std::size_t rows =
      static_cast<std::size_t>(convolution.in * convolution.layer.window * convolution.layer.window);
  const std::size_t columns = std::max<std::size_t>(ops_.matrix_bytes() / sizeof(float) / rows / 64 * 64, 64);
  return static_cast<int>(std::min(columns, out.plane()));
}

// Returns the matrix product of a convolution. If the convolution is a matrix product already, this is the
// product for the whole layer. Otherwise it is the product for the first columns, as many as are computed at
// once.
MatrixProduct Lpips::product(const Convolution& convolution, const PlanarSize& out) const {
  MatrixProduct p;
  p.rows = convolution.out;
  p.inner = convolution.in * convolution.layer.window * convolution.layer.window;
  p.columns = is_product(convolution) ? static_cast<int>(out.plane()) : columns_at_once(convolution, out);
  p.a = convolution.weight.view();
  p.b_pitch = p.columns;
  p.c_pitch = static_cast<int>(out.plane());
  return p;
}

void Lpips::add_need(const Convolution& convolution, const PlanarSize& size, Need& need) const {
  const PlanarSize out = output_size(convolution.layer, size);
  MatrixProduct p = product(convolution, out);
  if (!is_product(convolution))
    need.matrix =
        std::max(need.matrix, static_cast<std::size_t>(p.inner) * static_cast<std::size_t>(p.columns));
  // The memory of a product depends on the number of its columns and on the alignment of its output. So take
  // the maximum over a full and a partial product, each with and without an offset.
  const int left = static_cast<int>(out.plane()) % p.columns;
  for (const std::size_t offset : {0, 16})
    for (const int columns : {p.columns, left > 0 ? left : p.columns}) {
      p.c_offset = offset;
      p.columns = columns;
      need.product_bytes = std::max(need.product_bytes, ops_.product_bytes(p));
    }
}

Lpips::Need Lpips::need(PlanarSize size) const {
  Need need;
  std::size_t side = 0;  // index in features_ of the current layer
  need.features[side] = size.floats(3);
  for (const Stage& stage : stages_) {
    for (const Convolution& convolution : stage.convolutions) add_need(convolution, size, need);
    if (stage.layer.kind == LayerKind::fire)
      need.squeezed =
          std::max(need.squeezed, size.floats(static_cast<std::size_t>(stage.convolutions[0].out)));
    if (stage.layer.kind == LayerKind::tap) {
      need.plane = std::max(need.plane, size.plane());
      continue;
    }
    size = output_size(stage.layer, size);
    side = 1 - side;
    need.features[side] =
        std::max(need.features[side], size.floats(static_cast<std::size_t>(stage.channels)));
  }
  return need;
}

LpipsMemory Lpips::memory(PlanarSize size) const {
  check_size(size);
  const Need n = need(size);
  LpipsMemory memory;
  for (const Stage& stage : stages_) {
    memory.weights += stage.head.size() * sizeof(float);
    for (const Convolution& c : stage.convolutions)
      memory.weights += (c.weight.size() + c.bias.size()) * sizeof(float);
  }
  memory.features = (2 * (n.features[0] + n.features[1]) + n.squeezed) * sizeof(float);
  memory.matrix = n.matrix * sizeof(float);
  memory.product = n.product_bytes;
  memory.distances = (n.plane + sums_.size()) * sizeof(float);
  return memory;
}

void Lpips::reserve(const Need& need) {
  for (auto& image : features_)
    for (std::size_t side : {0, 1}) grow(device_, image[side], "network features", need.features[side]);
  if (need.squeezed > 0) grow(device_, squeezed_, "squeezed features", need.squeezed);
  if (need.matrix > 0) grow(device_, matrix_, "convolution matrix", need.matrix);
  grow(device_, distances_, "LPIPS distances", need.plane);
}

void Lpips::load_image(const DeviceImage& image, LpipsRange range, BufferView<float> to) {
  LoadImage load{.image = image, .out = to};
  for (std::size_t c = 0; c < 3; ++c) {
    const bool centred = range == LpipsRange::signed_one;
    load.scale[c] = static_cast<float>((centred ? 2 : 1) / kScale[c]);
    load.offset[c] = static_cast<float>(((centred ? -1 : 0) - kShift[c]) / kScale[c]);
  }
  ops_.load_image(load);
}

void Lpips::convolve(const Convolution& convolution, BufferView<float> image, PlanarSize size,
                     BufferView<float> to, int first_channel) {
  const Layer& layer = convolution.layer;
  const PlanarSize out = output_size(layer, size);
  const std::size_t first_element = static_cast<std::size_t>(first_channel) * out.plane();
  MatrixProduct p = product(convolution, out);
  p.c = to;
  p.c_offset = first_element;
  if (is_product(convolution)) {
    p.b = image;
    ops_.matrix_product(p);
  } else {
    p.b = matrix_.view();
    const int all = static_cast<int>(out.plane()), at_once = p.columns;
    for (int first = 0; first < all; first += at_once) {
      const int count = std::min(at_once, all - first);
      ops_.im2col({.image = image,
                   .size = size,
                   .channels = convolution.in,
                   .window = layer.window,
                   .stride = layer.stride,
                   .padding = layer.padding,
                   .out_width = out.width,
                   .first = first,
                   .count = count,
                   .pitch = p.b_pitch,
                   .matrix = matrix_.view()});
      p.columns = count;
      p.c_offset = first_element + static_cast<std::size_t>(first);
      ops_.matrix_product(p);
    }
  }
  ops_.bias_relu({.features = to,
                  .bias = convolution.bias.view(),
                  .size = out,
                  .first = first_element,
                  .channels = convolution.out});
}

void Lpips::run(const Stage& stage, BufferView<float> image, PlanarSize size, int channels,
                BufferView<float> to) {
  const auto& convolutions = stage.convolutions;
  switch (stage.layer.kind) {
    case LayerKind::convolution:
      return convolve(convolutions[0], image, size, to, 0);
    case LayerKind::fire:
      convolve(convolutions[0], image, size, squeezed_.view(), 0);
      convolve(convolutions[1], squeezed_.view(), size, to, 0);
      return convolve(convolutions[2], squeezed_.view(), size, to, convolutions[1].out);
    case LayerKind::pool:
      return ops_.max_pool({.image = image,
                            .size = size,
                            .out_size = output_size(stage.layer, size),
                            .channels = channels,
                            .window = stage.layer.window,
                            .stride = stage.layer.stride,
                            .out = to});
    case LayerKind::tap:
      return;
  }
}

double Lpips::distance(const DeviceImage& a, const DeviceImage& b, LpipsRange range) {
  if (a.size.width != b.size.width || a.size.height != b.size.height)
    fail(ErrorKind::data, "images of {} x {} and {} x {} pixels cannot be compared", a.size.width,
         a.size.height, b.size.width, b.size.height);
  check_size(a.size);
  reserve(need(a.size));
  PlanarSize size = a.size;
  std::size_t side = 0;
  int channels = 3;
  load_image(a, range, features_[0][side].view());
  load_image(b, range, features_[1][side].view());
  std::vector<double> pixels;  // number of pixels at each tap
  for (const Stage& stage : stages_) {
    if (stage.layer.kind == LayerKind::tap) {
      ops_.lpips_distance({.a = features_[0][side].view(),
                           .b = features_[1][side].view(),
                           .weights = stage.head.view(),
                           .size = size,
                           .channels = channels,
                           .scratch = distances_.view(),
                           .sums = sums_.view(),
                           .sums_offset = static_cast<int>(pixels.size()) * kPartialSums});
      pixels.push_back(static_cast<double>(size.pixels()));
      continue;
    }
    for (auto& image : features_) run(stage, image[side].view(), size, channels, image[1 - side].view());
    size = output_size(stage.layer, size);
    channels = stage.channels;
    side = 1 - side;
  }
  const std::vector<float> sums = sums_.download();
  double distance = 0;
  for (std::size_t i = 0; i < sums.size(); ++i)
    distance += static_cast<double>(sums[i]) / pixels[i / static_cast<std::size_t>(kPartialSums)];
  if (!std::isfinite(distance))
    fail(ErrorKind::numerical,
         "LPIPS with '{}' is not finite: the images contain values that are not finite, or the weights are "
         "wrong",
         network_->name);
  return distance;
}

}  // namespace ubs
