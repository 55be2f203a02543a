// SPDX-License-Identifier: Apache-2.0
// What each formulation costs, on ordinary splats.
#include <algorithm>
#include <array>
#include <chrono>
#include <memory>

#include "host/stress/sweep.hpp"
#include "host/stress/sweep_cases.hpp"
#include "host/stress/sweep_kernels.hpp"
#include "kernels/layout.h"

namespace ubs::stress {

SweepTimes time_formulations(Device& device) {
  opencl::OpenclDevice& opencl = opencl_of(device);
  constexpr std::uint32_t kCount = 16384, kRounds = 15;
  Generator g(5);
  SweepSet set = std::ranges::find(sweep_cases(), "query_beta", &SweepCase::name)->splats(1.0, 64, g);
  const std::size_t rows = set.splats[0].raw.size();
  std::vector<float> params(rows * kCount);
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t i = 0; i < kCount; ++i)
      params[r * kCount + i] = set.splats[i % set.splats.size()].raw[r];
  constexpr std::uint32_t kStacks = 2048;
  std::vector<float> points(2 * kSweepPoints * kStacks), ones(3 * kSweepPoints * kStacks, 1.0f);
  std::vector<float> v(static_cast<std::size_t>(kCount) * UBS_GRAD_STRIDE);
  for (float& p : points) p = static_cast<float>(uniform(g, 400, 600));
  for (float& value : v) value = static_cast<float>(uniform(g, -1, 1));
  Buffer<float> v_records(device, "v_records", v.size()), at(device, "points", points.size());
  Buffer<float> v_image(device, "v_image", ones.size()), image(device, "image", ones.size());
  Buffer<float> blended(device, "blended", static_cast<std::size_t>(kStacks) * 8 * UBS_GRAD_STRIDE);
  v_records.upload(v);
  at.upload(points);
  v_image.upload(ones);
  SweepTimes times;
  std::array<std::unique_ptr<SweepKernels>, 2> kernels;
  for (const int f : {0, 1}) {
    kernels[f] = std::make_unique<SweepKernels>(opencl, 7, f ? Formulation::naive : Formulation::safe);
    kernels[f]->upload(params, kCount, kCount, set.camera, set.settings);
    times.project_forward[f] = times.project_backward[f] = times.blend[f] = 1e30;
  }
  const auto least = [&](double& to, double per, const auto& work) {
    device.finish();
    const auto start = std::chrono::steady_clock::now();
    work();
    device.finish();
    to = std::min(
        to, std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - start).count() / per);
  };
  for (std::uint32_t round = 0; round < kRounds; ++round)
    for (const int f : {0, 1}) {
      SweepKernels& k = *kernels[f];
      least(times.project_forward[f], kCount, [&] { k.project_forward(); });
      least(times.project_backward[f], kCount, [&] { k.project_backward(v_records); });
      least(times.blend[f], 8.0 * kStacks * kSweepPoints,
            [&] { k.blend(k.records(), kStacks, 8, at, v_image, image, blended); });
    }
  return times;
}

}  // namespace ubs::stress
