// SPDX-License-Identifier: Apache-2.0
// lpips_reference() computes LPIPS in double precision. It interprets the description of the network with
// plain loops.
#pragma once

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "host/pipeline/lpips.hpp"
#include "host/pipeline/safetensors.hpp"

namespace ubs::oracle {

struct Features {
  int channels = 0;
  PlanarSize size;
  std::vector<double> values;  // (channels, height, width)
  Features() = default;
  Features(int c, PlanarSize s) : channels(c), size(s), values(static_cast<std::size_t>(c) * s.pixels()) {}
  double& at(int c, int y, int x) {
    return values[(static_cast<std::size_t>(c) * size.height + y) * size.width + x];
  }
  double at(int c, int y, int x) const { return const_cast<Features*>(this)->at(c, y, x); }
};

inline Features features(const std::vector<std::uint8_t>& bytes, PlanarSize size) {
  Features f(3, size);
  for (std::size_t i = 0; i < bytes.size(); ++i) f.values[i] = bytes[i] / 255.0;
  return f;
}

inline Features convolve(const Features& in, const Layer& layer, const Tensor& weight, const Tensor& bias) {
  Features out(static_cast<int>(weight.shape[0]), output_size(layer, in.size));
  const int n = layer.window;
  for (int o = 0; o < out.channels; ++o)
    for (int y = 0; y < out.size.height; ++y)
      for (int x = 0; x < out.size.width; ++x) {
        double sum = bias.values[static_cast<std::size_t>(o)];
        for (int c = 0; c < in.channels; ++c)
          for (int ky = 0; ky < n; ++ky)
            for (int kx = 0; kx < n; ++kx) {
              const int iy = y * layer.stride - layer.padding + ky,
                        ix = x * layer.stride - layer.padding + kx;
              if (iy < 0 || iy >= in.size.height || ix < 0 || ix >= in.size.width) continue;
              const auto at = static_cast<std::size_t>(((o * in.channels + c) * n + ky) * n + kx);
              sum += static_cast<double>(weight.values[at]) * in.at(c, iy, ix);
            }
        out.at(o, y, x) = std::max(sum, 0.0);
      }
  return out;
}

inline Features pool(const Features& in, const Layer& layer) {
  Features out(in.channels, output_size(layer, in.size));
  for (int c = 0; c < in.channels; ++c)
    for (int y = 0; y < out.size.height; ++y)
      for (int x = 0; x < out.size.width; ++x) {
        double most = -1e300;
        for (int iy = y * layer.stride; iy < std::min(y * layer.stride + layer.window, in.size.height); ++iy)
          for (int ix = x * layer.stride; ix < std::min(x * layer.stride + layer.window, in.size.width); ++ix)
            most = std::max(most, in.at(c, iy, ix));
        out.at(c, y, x) = most;
      }
  return out;
}

inline Features fire(const Features& in, const TensorFile& w, const std::string& name) {
  const Layer one{LayerKind::convolution, 0, 1, 1, 0}, three{LayerKind::convolution, 0, 3, 1, 1};
  const auto part = [&](const Features& f, const char* which, const Layer& layer) {
    return convolve(f, layer, w.at(name + which + ".weight"), w.at(name + which + ".bias"));
  };
  const Features squeezed = part(in, ".squeeze", one);
  Features out = part(squeezed, ".expand1x1", one);
  const Features wide = part(squeezed, ".expand3x3", three);
  out.channels += wide.channels;
  out.values.insert(out.values.end(), wide.values.begin(), wide.values.end());
  return out;
}

// Returns the LPIPS distance between two images. Their values are in [0, 1] and have the shape (channels,
// height, width). If `centred` is true, the values are mapped to [-1, 1] before they enter the network.
inline double lpips_reference(const Network& network, const TensorFile& w, std::array<Features, 2> f,
                              bool centred) {
  const double shift[3] = {-0.030, -0.088, -0.188}, scale[3] = {0.458, 0.448, 0.450};
  for (Features& image : f)
    for (std::size_t i = 0; i < image.values.size(); ++i) {
      const std::size_t c = i / image.size.pixels();
      image.values[i] = ((centred ? 2 * image.values[i] - 1 : image.values[i]) - shift[c]) / scale[c];
    }
  double distance = 0;
  int taps = 0;
  for (const Layer& layer : network.layers) {
    const std::string name = fmt::format("features.{}", layer.number);
    if (layer.kind == LayerKind::tap) {
      const Tensor& head = w.at(fmt::format("lin{}.weight", taps++));
      const PlanarSize size = f[0].size;
      double sum = 0;
      for (int y = 0; y < size.height; ++y)
        for (int x = 0; x < size.width; ++x) {
          double norm[2] = {0, 0};
          for (int i = 0; i < 2; ++i) {
            for (int c = 0; c < f[i].channels; ++c) norm[i] += f[i].at(c, y, x) * f[i].at(c, y, x);
            norm[i] = std::sqrt(norm[i]) + 1e-10;
          }
          for (int c = 0; c < f[0].channels; ++c) {
            const double d = f[0].at(c, y, x) / norm[0] - f[1].at(c, y, x) / norm[1];
            sum += head.values[static_cast<std::size_t>(c)] * d * d;
          }
        }
      distance += sum / static_cast<double>(size.pixels());
      continue;
    }
    for (Features& image : f) {
      if (layer.kind == LayerKind::convolution)
        image = convolve(image, layer, w.at(name + ".weight"), w.at(name + ".bias"));
      else
        image = layer.kind == LayerKind::pool ? pool(image, layer) : fire(image, w, name);
    }
  }
  return distance;
}

}  // namespace ubs::oracle
