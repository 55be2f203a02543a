// SPDX-License-Identifier: Apache-2.0
#include "tests/stress/device_runner.hpp"

#include <algorithm>
#include <cstring>

#include "host/pipeline/device_model.hpp"

namespace ubs::stress {

struct DeviceRunner::Form {
  Form(Device& device, const KernelConfig& config)
      : stages(make_stages(device, config)),
        renderer(device, *stages),
        v_params(device, "parameter gradients", 0) {}
  std::unique_ptr<Stages> stages;
  Renderer renderer;
  Buffer<float> v_params;
};

bool same_bits(std::span<const float> a, std::span<const float> b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

DeviceRunner::DeviceRunner(Device& device, RasterKind raster) : device_(device), raster_(raster) {}
DeviceRunner::~DeviceRunner() = default;

DeviceRunner::Form& DeviceRunner::form(int dim, const ModelVariant& variant, bool query_grad) {
  auto& entry = forms_[{dim, variant_numbers(variant), query_grad}];
  if (!entry) {
    KernelConfig config;
    config.dim = dim;
    config.raster = raster_;
    config.query_grad = query_grad;
    config.variant = variant;
    entry = std::make_unique<Form>(device_, config);
  }
  return *entry;
}

Stages& DeviceRunner::stages(int dim, const ModelVariant& variant, bool query_grad) {
  return *form(dim, variant, query_grad).stages;
}

DeviceResult DeviceRunner::run(const Case& c, const std::vector<float>& weights) {
  Form& f = form(c.model.dim, c.model.variant, c.query_grad);
  const DeviceModel model(device_, c.model);
  f.renderer.set_cameras({c.camera});
  DeviceResult result;
  result.totals = f.renderer.forward(model.view(), 0, c.settings, !weights.empty());
  const RenderedView view = f.renderer.download();
  const std::size_t pixels = view.alpha.size();
  result.image.resize(3 * pixels);
  for (std::size_t i = 0; i < pixels; ++i)
    for (std::size_t channel = 0; channel < 3; ++channel)
      result.image[channel * pixels + i] = view.rgb[3 * i + channel];
  result.alpha = view.alpha;
  if (!weights.empty()) {
    device_.write(*f.renderer.v_image().memory, 0,
                  std::as_bytes(std::span<const float>(padded_planes(weights, f.renderer.shape()))));
    f.v_params.reserve(static_cast<std::size_t>(model.rows()) * model.stride());
    f.renderer.backward(f.v_params.view(), false);
    // Download all rows at once, because one copy per row costs more than the kernels of a small case.
    std::vector<float> rows(static_cast<std::size_t>(model.rows()) * model.stride());
    f.v_params.download(std::span(rows));
    result.gradient = SplatModel(c.model.dim, c.model.count, c.model.variant);
    for (int r = 0; r < model.rows(); ++r)
      std::copy_n(rows.begin() + static_cast<std::ptrdiff_t>(r) * model.stride(), c.model.count,
                  result.gradient.row(r).begin());
  }
  if (disturb) disturb(c, result);
  return result;
}

}  // namespace ubs::stress
