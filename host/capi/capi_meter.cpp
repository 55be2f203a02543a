// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for comparing images.
#include <cstdlib>
#include <limits>
#include <sstream>

#include "host/capi/metrics.hpp"
#include "host/model/image_comparison.hpp"
#include "host/pipeline/network.hpp"
#include "host/run/verified_device.hpp"

namespace ubs::facade {
namespace {

LpipsRequest request_of(const char* networks, const char* weights) {
  LpipsRequest request;
  std::istringstream names(networks ? networks : "");
  for (std::string name; std::getline(names, name, ',');) {
    lpips_network(name);  // throws for unknown networks
    request.networks.push_back(name);
  }
  if (request.networks.empty()) return request;
  const char* variable = std::getenv("UBS_LPIPS_WEIGHTS");
  request.weights = weights ? weights : variable ? variable : "";
  if (request.weights.empty())
    fail(ErrorKind::usage, "LPIPS requires weights: pass their file or folder, or set UBS_LPIPS_WEIGHTS");
  return request;
}

}  // namespace

ubs_metrics metrics_to(const ViewMetrics& from) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const auto lpips = [&](const char* network, LpipsRange range) {
    for (const NamedValue& value : from.lpips)
      if (value.name == lpips_name(network, range)) return value.value;
    return kNone;
  };
  ubs_metrics to{};
  to.psnr = from.psnr_channel_mean;
  to.psnr_joint = from.psnr;
  to.ssim = from.ssim;
  to.ssim_valid = from.ssim_valid.value_or(kNone);
  to.lpips_alex = lpips("alex", LpipsRange::signed_one);
  to.lpips_squeeze = lpips("squeeze", LpipsRange::signed_one);
  to.lpips_vgg = lpips("vgg", LpipsRange::signed_one);
  to.lpips_alex_unit = lpips("alex", LpipsRange::unit);
  to.lpips_squeeze_unit = lpips("squeeze", LpipsRange::unit);
  to.lpips_vgg_unit = lpips("vgg", LpipsRange::unit);
  return to;
}

}  // namespace ubs::facade

using namespace ubs;
using namespace ubs::facade;

ubs_status ubs_meter_create(ubs_device* device, const char* networks, const char* weights,
                            ubs_meter** meter) {
  return made(meter, [&] {
    const LpipsRequest request = request_of(networks, weights);
    const std::shared_ptr<OpenDevice> open = given(device, "device").open;
    const std::lock_guard lock(open->mutex);
    auto created = std::make_unique<ubs_meter>();
    created->open = open;
    verify_device(created->open->device->info(), created->open->index,
                  comparing_use(!request.networks.empty()));
    created->comparison.emplace(*created->open->device, request);
    return created;
  });
}

void ubs_meter_free(ubs_meter* meter) {
  if (!meter) return;
  const std::shared_ptr<OpenDevice> open = meter->open;
  const std::lock_guard lock(open->mutex);
  delete meter;
}

ubs_status ubs_meter_compare(ubs_meter* meter, int32_t width, int32_t height, const float* truth,
                             const float* image, ubs_metrics* metrics) {
  return guarded([&] {
    ubs_meter& m = given(meter, "meter");
    taken(metrics, "metrics");
    if (std::min(width, height) < 1 || std::max(width, height) > kMaxPixelsAcross ||
        std::int64_t{width} * height > kMaxPixels)
      fail(ErrorKind::usage,
           "the image size {}x{} is not possible: width and height must be 1 to {}, and an image can have at "
           "most {} pixels",
           width, height, kMaxPixelsAcross, kMaxPixels);
    const std::size_t values = 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    const std::span<const float> a(&given(truth, "truth"), values), b(&given(image, "image"), values);
    const std::lock_guard lock(m.open->mutex);
    put(metrics, metrics_to(m.comparison->measure("image", width, height, a, b)), "metrics");
  });
}
