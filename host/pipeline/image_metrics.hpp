// SPDX-License-Identifier: Apache-2.0
// The image metrics beyond those of the loss (PSNR, zero-padded SSIM: Stages::image_loss): SSIM over the
// windows inside of the image, and LPIPS with the networks that are asked for.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/pipeline/lpips.hpp"

namespace ubs {

struct LpipsRequest {
  std::vector<std::string> networks;  // alex, squeeze, vgg; empty: no LPIPS
  // A safetensors file, or a folder with lpips_alex.safetensors, lpips_squeeze.safetensors,
  // lpips_vgg.safetensors.
  std::filesystem::path weights;
  std::vector<LpipsRange> ranges{LpipsRange::signed_one, LpipsRange::unit};
};

// Of one network. Throws Error(data) naming it when a folder does not have it.
std::filesystem::path lpips_weight_file(const std::filesystem::path& weights, const std::string& network);

struct NamedValue {
  std::string name;
  double value = 0;
};
// "lpips_vgg" for images fed as 2 v - 1, "lpips_vgg_unit" for images fed in [0, 1].
std::string lpips_name(std::string_view network, LpipsRange range);

class ImageMetrics {
 public:
  // Reads the weights; throws Error(data) for files that are missing or do not fit.
  ImageMetrics(Device& device, const LpipsRequest& request);

  // Throws Error(data) where a network cannot take images of this size, Error(memory) where the device
  // cannot.
  void check_size(PlanarSize size) const;
  // Mean over the (width - 10)(height - 10) windows and three channels; nothing for smaller images. Waits.
  std::optional<double> valid_ssim(const DeviceImage& a, const DeviceImage& b);
  // Of every network and range asked for, in that order. Waits.
  std::vector<NamedValue> lpips(const DeviceImage& a, const DeviceImage& b);
  // Device memory of the networks for images of this size, their weights included.
  std::uint64_t lpips_bytes(PlanarSize size) const;

 private:
  Device& device_;
  std::vector<LpipsRange> ranges_;
  std::unique_ptr<MetricOps> ops_;
  std::vector<std::unique_ptr<Lpips>> networks_;
  Buffer<float> a_, b_, scratch_, sums_;  // of valid_ssim
};

}  // namespace ubs
