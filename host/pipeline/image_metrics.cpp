// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/image_metrics.hpp"

#include <limits>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"

namespace ubs {

namespace fs = std::filesystem;

fs::path lpips_weight_file(const fs::path& weights, const std::string& network) {
  if (weights.empty())
    fail(ErrorKind::usage,
         "LPIPS requires weights: pass --lpips-weights or set UBS_LPIPS_WEIGHTS (docs/metrics.md)");
  if (!is_folder(weights)) return weights;
  const fs::path file = weights / fmt::format("lpips_{}.safetensors", network);
  if (!path_exists(file))
    fail(ErrorKind::data, "{}: no such file: create it with tools/export_lpips_weights.py {}", file.string(),
         network);
  return file;
}

std::string lpips_name(std::string_view network, LpipsRange range) {
  return fmt::format("lpips_{}{}", network, range == LpipsRange::unit ? "_unit" : "");
}

ImageMetrics::ImageMetrics(Device& device, const LpipsRequest& request)
    : device_(device),
      ranges_(request.ranges),
      ops_(make_metric_ops(device)),
      sums_(device, "SSIM sums", 3 * kPartialSums) {
  for (const std::string& name : request.networks) {
    const Network& network = lpips_network(name);
    networks_.push_back(std::make_unique<Lpips>(device, *ops_, network,
                                                read_safetensors(lpips_weight_file(request.weights, name))));
  }
}

void ImageMetrics::check_size(PlanarSize size) const {
  for (const auto& network : networks_) network->check_size(size);
  const std::uint64_t needed = lpips_bytes(size), all = device_.info().memory_bytes;
  if (needed > all)
    fail(ErrorKind::memory,
         "LPIPS of {} x {} pixels needs {} MiB, but {} has {} MiB: use a smaller network or --downscale",
         size.width, size.height, needed >> 20, device_.info().name, all >> 20);
}

std::optional<double> ImageMetrics::valid_ssim(const DeviceImage& a, const DeviceImage& b) {
  const PlanarSize size = a.size;
  if (size.width < kSsimWindow || size.height < kSsimWindow) return std::nullopt;
  constexpr std::size_t kMostOffset = std::numeric_limits<int>::max();  // kernels use int offsets
  if (valid_ssim_scratch(size) > kMostOffset)
    fail(ErrorKind::data, "images of {} x {} pixels are too large to compare", size.width, size.height);
  if (a_.size() < size.floats(3)) {
    a_ = Buffer<float>(device_, "SSIM images", size.floats(3));
    b_ = Buffer<float>(device_, "SSIM images", size.floats(3));
  }
  if (scratch_.size() < valid_ssim_scratch(size))
    scratch_ = Buffer<float>(device_, "SSIM window sums", valid_ssim_scratch(size));
  ops_->load_image({.image = a, .out = a_.view()});
  ops_->load_image({.image = b, .out = b_.view()});
  for (int channel = 0; channel < 3; ++channel)
    ops_->valid_ssim({.a = a_.view(),
                      .b = b_.view(),
                      .size = size,
                      .channel = channel,
                      .scratch = scratch_.view(),
                      .sums = sums_.view(),
                      .sums_offset = channel * kPartialSums});
  double dissimilarity = 0;
  for (const float sum : sums_.download()) dissimilarity += static_cast<double>(sum);
  return 1 - dissimilarity / (3 * static_cast<double>(valid_windows(size).pixels()));
}

std::vector<NamedValue> ImageMetrics::lpips(const DeviceImage& a, const DeviceImage& b) {
  std::vector<NamedValue> values;
  for (const auto& network : networks_)
    for (const LpipsRange range : ranges_)
      values.push_back({lpips_name(network->network().name, range), network->distance(a, b, range)});
  return values;
}

std::uint64_t ImageMetrics::lpips_bytes(PlanarSize size) const {
  std::uint64_t total = 0;
  for (const auto& network : networks_) total += network->memory(size).total();
  return total;
}

}  // namespace ubs
