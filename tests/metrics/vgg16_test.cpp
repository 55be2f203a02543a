// SPDX-License-Identifier: Apache-2.0
// Tests LPIPS with a VGG16 of full size, whose random weights are read from a safetensors file. The expected
// distances are computed by an independent implementation of the network. It does not use the list of layers
// in ubs, so a wrong order of layers, pooling or taps is detected. (metrics_test.cpp compares all networks
// with few channels, but uses the list of layers in ubs.)
#include <catch2/catch.hpp>

#include "host/check/metric_inputs.hpp"
#include "host/dataset/image.hpp"
#include "host/device/registry.hpp"
#include "host/pipeline/image_metrics.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/temp_folder.hpp"
#include "tests/support/write_safetensors.hpp"

namespace {

using namespace ubs;

// A convolution of VGG16 (configuration D of Simonyan and Zisserman). `number` is its index in torchvision's
// `features`, which also counts ReLUs and poolings. `tap` marks the layers whose output LPIPS compares: the
// last ReLU before each pooling, and the last ReLU of the network.
struct Vgg16Layer {
  int number, in, out;
  bool tap;  // pooling by two follows each tap except the last
};
constexpr Vgg16Layer kVgg16[] = {{0, 3, 64, false},    {2, 64, 64, true},     {5, 64, 128, false},
                                 {7, 128, 128, true},  {10, 128, 256, false}, {12, 256, 256, false},
                                 {14, 256, 256, true}, {17, 256, 512, false}, {19, 512, 512, false},
                                 {21, 512, 512, true}, {24, 512, 512, false}, {26, 512, 512, false},
                                 {28, 512, 512, true}};

// Returns uniform weights with the variance of He et al., so that activations neither vanish nor explode.
TensorFile random_vgg16() {
  std::mt19937 generator(11);
  TensorFile file{"random", {}};
  const auto fill = [&](const std::string& name, std::vector<std::size_t> shape, float low, float high) {
    std::size_t count = 1;
    for (const std::size_t extent : shape) count *= extent;
    std::vector<float> values(count);
    for (float& value : values)
      value = low + (high - low) * static_cast<float>(generator() >> 8) / static_cast<float>(1 << 24);
    file.tensors[name] = {std::move(shape), std::move(values)};
  };
  int taps = 0;
  for (const Vgg16Layer& layer : kVgg16) {
    const auto in = static_cast<std::size_t>(layer.in), out = static_cast<std::size_t>(layer.out);
    const float limit = std::sqrt(6.0f / static_cast<float>(9 * in));
    fill(fmt::format("features.{}.weight", layer.number), {out, in, 3, 3}, -limit, limit);
    fill(fmt::format("features.{}.bias", layer.number), {out}, -0.2f, 0.2f);
    if (layer.tap) fill(fmt::format("lin{}.weight", taps++), {1, out, 1, 1}, 0.0f, 1.0f);
  }
  return file;
}

struct Planes {
  int channels, height, width;
  std::vector<double> values;
};

Planes convolve_3x3_relu(const Planes& in, const Tensor& weight, const Tensor& bias) {
  const int h = in.height, w = in.width, outs = static_cast<int>(bias.values.size());
  const std::size_t plane = static_cast<std::size_t>(h) * static_cast<std::size_t>(w);
  Planes out{outs, h, w, std::vector<double>(static_cast<std::size_t>(outs) * plane)};
  for (int o = 0; o < outs; ++o) {
    double* to = &out.values[static_cast<std::size_t>(o) * plane];
    std::fill_n(to, plane, static_cast<double>(bias.values[static_cast<std::size_t>(o)]));
    for (int c = 0; c < in.channels; ++c)
      for (int k = 0; k < 9; ++k) {
        const int dy = k / 3 - 1, dx = k % 3 - 1;
        const double value = weight.values[static_cast<std::size_t>((o * in.channels + c) * 9 + k)];
        const double* from = &in.values[static_cast<std::size_t>(c) * plane];
        for (int y = std::max(0, -dy); y < std::min(h, h - dy); ++y)
          for (int x = std::max(0, -dx); x < std::min(w, w - dx); ++x)
            to[y * w + x] += value * from[(y + dy) * w + x + dx];
      }
    for (std::size_t i = 0; i < plane; ++i) to[i] = std::max(to[i], 0.0);
  }
  return out;
}

Planes halve(const Planes& in) {
  Planes out{in.channels, in.height / 2, in.width / 2, {}};
  for (int c = 0; c < in.channels; ++c)
    for (int y = 0; y < out.height; ++y)
      for (int x = 0; x < out.width; ++x) {
        const double* at = &in.values[static_cast<std::size_t>((c * in.height + 2 * y) * in.width + 2 * x)];
        out.values.push_back(std::max(std::max(at[0], at[1]), std::max(at[in.width], at[in.width + 1])));
      }
  return out;
}

// Returns the mean over pixels of the weighted squared difference of the normalised features.
double tap_distance(const Planes& a, const Planes& b, const Tensor& head) {
  const std::size_t plane = static_cast<std::size_t>(a.height) * static_cast<std::size_t>(a.width);
  double sum = 0;
  for (std::size_t p = 0; p < plane; ++p) {
    double length_a = 0, length_b = 0;
    for (std::size_t i = p; i < a.values.size(); i += plane) {
      length_a += a.values[i] * a.values[i];
      length_b += b.values[i] * b.values[i];
    }
    length_a = std::sqrt(length_a) + 1e-10;
    length_b = std::sqrt(length_b) + 1e-10;
    for (std::size_t c = 0; c < head.values.size(); ++c) {
      const double d = a.values[c * plane + p] / length_a - b.values[c * plane + p] / length_b;
      sum += static_cast<double>(head.values[c]) * d * d;
    }
  }
  return sum / static_cast<double>(plane);
}

Planes network_input(const std::vector<std::uint8_t>& bytes, PlanarSize size, bool centred) {
  constexpr double kShift[] = {-0.030, -0.088, -0.188}, kScale[] = {0.458, 0.448, 0.450};
  Planes planes{3, size.height, size.width, {}};
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const std::size_t c = i / size.pixels();
    const double value = bytes[i] / 255.0;
    planes.values.push_back(((centred ? 2 * value - 1 : value) - kShift[c]) / kScale[c]);
  }
  return planes;
}

double vgg16_lpips(const TensorFile& file, Planes a, Planes b) {
  double distance = 0;
  int taps = 0;
  for (const Vgg16Layer& layer : kVgg16) {
    const Tensor& weight = file.at(fmt::format("features.{}.weight", layer.number));
    const Tensor& bias = file.at(fmt::format("features.{}.bias", layer.number));
    a = convolve_3x3_relu(a, weight, bias);
    b = convolve_3x3_relu(b, weight, bias);
    if (!layer.tap) continue;
    distance += tap_distance(a, b, file.at(fmt::format("lin{}.weight", taps++)));
    if (taps < 5) a = halve(a), b = halve(b);
  }
  return distance;
}

}  // namespace

TEST_CASE("lpips: VGG16 of full size agrees with an independent implementation in double precision",
          "[metrics]") {
  const PlanarSize size{35, 33};  // odd, so that the first two of the four poolings ignore a remainder
  const auto pair = check::image_pair(size);
  const TensorFile weights = random_vgg16();
  const test::TempFolder folder;
  test::put_safetensors(folder / "lpips_vgg.safetensors", weights.tensors);
  std::map<std::string, double> expected;
  for (const LpipsRange range : {LpipsRange::signed_one, LpipsRange::unit}) {
    const bool centred = range == LpipsRange::signed_one;
    expected[lpips_name("vgg", range)] =
        vgg16_lpips(weights, network_input(pair[0], size, centred), network_input(pair[1], size, centred));
  }
  for (const auto& device : devices_under_test()) {
    if (device->info().name == "CUDA on the host") continue;  // takes minutes with one thread
    INFO(device->info().name);
    ImageMetrics metrics(*device, {{"vgg"}, folder.path(), {LpipsRange::signed_one, LpipsRange::unit}});
    const check::Uploaded up = check::upload(*device, pair, size);
    const std::vector<NamedValue> values = metrics.lpips(up.a, up.b);
    REQUIRE(values.size() == 2);
    for (const NamedValue& value : values) {
      CAPTURE(value.name, value.value, value.value - expected.at(value.name));
      REQUIRE(expected.at(value.name) > 0.02);
      // The largest observed relative error is 2.7e-7 (PoCL).
      CHECK(value.value == Approx(expected.at(value.name)).epsilon(5.4e-7));
    }
    // The two input ranges must give different distances.
    CHECK(std::abs(values[0].value - values[1].value) > 1e-3);
  }
}
