// SPDX-License-Identifier: Apache-2.0
// ImageComparison compares two images in host memory and computes their PSNR, SSIM and LPIPS.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "host/device/stages.hpp"
#include "host/pipeline/image_metrics.hpp"
#include "host/scene/dataset.hpp"
#include "host/train/evaluate.hpp"

namespace ubs {

class ImageComparison {
 public:
  ImageComparison(Device& device, const LpipsRequest& request);

  // Compares two images. Both must have the same size, which this function does not check.
  ViewMetrics measure(const std::string& name, const Image8& truth, const Image8& image);
  // Compares two images of shape (height, width, 3). Both are clamped to [0, 1].
  ViewMetrics measure(const std::string& name, int width, int height, std::span<const float> truth,
                      std::span<const float> image);
  // Returns the metrics of images in device memory, for code that renders and compares images itself.
  ImageMetrics& metrics() { return more_; }

 private:
  ViewMetrics measure(const std::string& name, const ImageShape& shape, std::span<const float> image,
                      BufferView<std::uint8_t> bytes, BufferView<float> values, const DeviceImage& truth);
  template <typename T>
  Buffer<T> upload(const std::vector<T>& values);

  Device& device_;
  std::unique_ptr<Stages> stages_;
  ImageMetrics more_;
  Buffer<float> sums_;
};

}  // namespace ubs
