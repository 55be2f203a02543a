// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "host/check/metric_inputs.hpp"
#include "host/check/stage_checks.hpp"
#include "host/device/registry.hpp"
#include "host/pipeline/image_metrics.hpp"

namespace ubs::check {

// The bounds and the images are those of tests/metrics/metrics_test.cpp. The largest errors that were
// measured are 2.9e-7 for LPIPS and 6.8e-8 for SSIM.
Findings check_networks(Device& device) {
  const PlanarSize size{kMetricWidth, kMetricHeight};
  const Uploaded up = upload(device, image_pair(size), size);
  const MetricVectors& expected = embedded_vectors().metrics;
  const auto ops = make_metric_ops(device);
  const Network& network = lpips_network("squeeze");
  const TensorFile weights = random_weights(network, kNetworkSeed);
  WorstFinding worst("image metrics");
  Lpips lpips(device, *ops, network, weights);
  worst.add("LPIPS", std::abs(lpips.distance(up.a, up.b, LpipsRange::signed_one) - expected.lpips), 6e-7);
  ImageMetrics metrics(device, {});
  worst.add("SSIM of windows inside the image",
            std::abs(metrics.valid_ssim(up.a, up.b).value_or(NAN) - expected.ssim), 1.4e-7);
  return {worst.finding()};
}

}  // namespace ubs::check
