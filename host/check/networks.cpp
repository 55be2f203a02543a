// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "host/check/stage_checks.hpp"
#include "host/device/registry.hpp"
#include "host/metrics/image_metrics.hpp"
#include "host/oracle/image_pair.hpp"
#include "host/oracle/oracle.hpp"

namespace ubs::check {

// Bounds and images are those of tests/metrics/metrics_test.cpp: 2.9e-7 and 6.8e-8 seen.
Findings check_networks(Device& device) {
  const PlanarSize size{37, 30};
  const auto pair = oracle::image_pair(size);
  const std::array<oracle::Features, 2> f{oracle::features(pair[0], size), oracle::features(pair[1], size)};
  const oracle::Uploaded up = oracle::upload(device, pair, size);
  const auto ops = make_metric_ops(device);
  const Network& network = lpips_network("squeeze");
  const TensorFile weights = oracle::random_weights(network, 7);
  Worst worst("image metrics");
  Lpips lpips(device, *ops, network, weights);
  worst.add("LPIPS",
            std::abs(lpips.distance(up.a, up.b, LpipsRange::signed_one) -
                     oracle::lpips_reference(network, weights, f, true)),
            6e-7);
  ImageMetrics metrics(device, {});
  worst.add("SSIM over whole windows",
            std::abs(metrics.valid_ssim(up.a, up.b).value_or(NAN) -
                     oracle::valid_ssim(f[0].values, f[1].values, 3, size.height, size.width)),
            1.4e-7);
  return {worst.finding()};
}

}  // namespace ubs::check
