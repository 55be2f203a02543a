// SPDX-License-Identifier: Apache-2.0
// ImageMetrics computes image metrics in addition to those of Stages::image_loss, which are PSNR and an SSIM
// with zeros outside of the image. The additional metrics are the SSIM over the windows inside the image, and
// LPIPS with the requested networks.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/pipeline/lpips.hpp"

namespace ubs {

// LpipsRequest selects the networks and ranges for which LPIPS is computed.
struct LpipsRequest {
  std::vector<std::string> networks;  // alex, squeeze, vgg; empty: no LPIPS
  // A safetensors file, or a folder that contains lpips_alex.safetensors, lpips_squeeze.safetensors and
  // lpips_vgg.safetensors.
  std::filesystem::path weights;
  // Each network computes one distance for each of these ranges.
  std::vector<LpipsRange> ranges{LpipsRange::signed_one, LpipsRange::unit};
};

// Returns the weight file of a network. Throws Error(usage) if `weights` is empty, and Error(data) with the
// path of the file if the folder does not contain it.
std::filesystem::path lpips_weight_file(const std::filesystem::path& weights, const std::string& network);

struct NamedValue {
  std::string name;
  double value = 0;
};
// Returns the name of a metric: for example, "lpips_vgg" if the network gets images as 2 v - 1, and
// "lpips_vgg_unit" if it gets them in [0, 1].
std::string lpips_name(std::string_view network, LpipsRange range);

class ImageMetrics {
 public:
  // Reads the weights. Throws Error(data) if files are missing or do not match the networks, and Error(usage)
  // if the request contains networks but no weights, or an unknown network.
  ImageMetrics(Device& device, const LpipsRequest& request);

  // Throws Error(data) if a network cannot process images of this size, and Error(memory) if the device has
  // not enough memory for them.
  void check_size(PlanarSize size) const;
  // Waits for the device and returns the SSIM, averaged over the three channels and over all 11 x 11 windows
  // that are inside the image. Returns nothing if the image is smaller than a window.
  std::optional<double> valid_ssim(const DeviceImage& a, const DeviceImage& b);
  // Waits for the device and returns one LPIPS distance for every combination of a requested network and a
  // requested range. The order is that of the networks; the ranges of one network follow each other.
  std::vector<NamedValue> lpips(const DeviceImage& a, const DeviceImage& b);
  // Returns the device memory of the networks for images of this size, including their weights.
  std::uint64_t lpips_bytes(PlanarSize size) const;

 private:
  Device& device_;
  std::vector<LpipsRange> ranges_;
  std::unique_ptr<MetricOps> ops_;
  std::vector<std::unique_ptr<Lpips>> networks_;
  Buffer<float> a_, b_, scratch_, sums_;  // used by valid_ssim()
};

}  // namespace ubs
