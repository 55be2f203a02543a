// SPDX-License-Identifier: Apache-2.0
// Tests KernelConfig::gaussian_arrays: Gaussians in arrays of the program have the same image and gradient as
// the same splats in rows of raw parameters, for plain colours, every degree of the harmonics and every
// vector width. The accuracy of the latter is tested by oracle_comparison_test.cpp.
#include <bit>
#include <catch2/catch.hpp>
#include <cmath>

#include "host/lab/oracle/scenes.hpp"
#include "host/opencl/platform.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/view_gradient.hpp"
#include "tests/support/compare.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

// Arrays with the layout that GaussianArrays describes.
struct Arrays {
  std::vector<float> means, quats, scales, opacities, colours;
  std::uint32_t bases = 0;

  Arrays(std::size_t count, int bases_of_harmonics)
      : means(3 * count),
        quats(4 * count),
        scales(3 * count),
        opacities(count),
        bases(static_cast<std::uint32_t>(bases_of_harmonics)) {
    colours.assign(3 * count * bases, 7.0f);
  }
  std::array<std::vector<float>*, 5> all() { return {&means, &quats, &scales, &opacities, &colours}; }
};

// The same arrays in the memory of a device, and a table of their addresses.
struct DeviceArrays {
  std::vector<Buffer<float>> buffers;
  Buffer<float> table;

  DeviceArrays(Device& device, Arrays& arrays) {
    std::array<float*, 5> at{};
    for (const std::vector<float>* values : arrays.all()) {
      buffers.emplace_back(device, "array", values->size());
      buffers.back().upload(*values);
      at[buffers.size() - 1] = static_cast<float*>(buffers.back().view().memory->address().pointer);
    }
    const GaussianArrays addresses{at[0], at[1], at[2], at[3], at[4], arrays.bases};
    const auto words = std::bit_cast<std::array<float, sizeof addresses / sizeof(float)>>(addresses);
    table = Buffer<float>(device, "addresses", words.size());
    table.upload(words);
  }
  void download(Arrays& arrays) const {
    const auto all = arrays.all();
    for (std::size_t i = 0; i < all.size(); ++i) buffers[i].download(std::span<float>(*all[i]));
  }
};

double sigmoid(double x) { return 1 / (1 + std::exp(-x)); }

// Calls `copy` with every value of `arrays` and the row and splat that it belongs to.
template <typename Copy>
void for_each_value(const ParameterLayout& layout, std::size_t count, Arrays& arrays, const Copy& copy) {
  const int bases = std::max(1, layout.variant.harmonics());
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < 3; ++k) copy(arrays.means[3 * i + k], layout.xyz + static_cast<int>(k), i);
    for (std::size_t k = 0; k < 4; ++k)
      copy(arrays.quats[4 * i + k], layout.l_triangle + static_cast<int>(k), i);
    for (std::size_t k = 0; k < 3; ++k) copy(arrays.scales[3 * i + k], layout.scale + static_cast<int>(k), i);
    copy(arrays.opacities[i], layout.opacity, i);
    for (int k = 0; k < bases; ++k)
      for (int c = 0; c < 3; ++c)
        copy(arrays
                 .colours[3 * (i * arrays.bases + static_cast<std::size_t>(k)) + static_cast<std::size_t>(c)],
             layout.rgb + (k == 0 ? c : 3 + c * (bases - 1) + k - 1), i);
  }
}

struct Errors {
  double loss = 0, gradient = 0;
};

Errors errors_of(Device& device, RasterKind raster, ColourMode colour, std::size_t count, int more_bases) {
  const ModelVariant variant{
      .rot_mode = RotMode::quaternion, .kernel = SpatialKernel::gaussian, .colour = colour};
  const oracle::Scene scene = oracle::regular_scene(
      {.count = count, .dim = 3, .seed = 5, .width = 45, .height = 38, .variant = variant});
  const std::vector<float> target(scene.target.begin(), scene.target.end());
  KernelConfig config{.dim = 3, .raster = raster, .query_grad = true, .variant = variant};
  const auto stages = make_stages(device, config);
  const ViewGradient rows = view_gradient(device, *stages, scene.model, scene.camera, target, {}, 0.2f, {});

  // The values of the rows, and the gradients with respect to scales and opacities instead of raw parameters.
  const ParameterLayout layout = scene.model.layout();
  Arrays arrays(count, std::max(1, variant.harmonics()) + more_bases), expected = arrays, found = arrays;
  const auto is_scale = [&](int row) { return row >= layout.scale && row < layout.scale + 3; };
  for_each_value(layout, count, arrays, [&](float& value, int row, std::size_t i) {
    const double raw = scene.model.row(row)[i];
    const double shown = is_scale(row)           ? std::log1p(std::exp(raw))
                         : row == layout.opacity ? sigmoid(raw)
                                                 : raw;
    value = static_cast<float>(shown);
  });
  for_each_value(layout, count, expected, [&](float& value, int row, std::size_t i) {
    const double raw = scene.model.row(row)[i], v = rows.values.row(row)[i];
    const double slope = is_scale(row)           ? sigmoid(raw)
                         : row == layout.opacity ? sigmoid(raw) * sigmoid(-raw)
                                                 : 1;
    value = static_cast<float>(v / slope);
  });

  config.gaussian_arrays = true;
  const auto array_stages = make_stages(device, config);
  Renderer renderer(device, *array_stages);
  const DeviceArrays given(device, arrays), to(device, found);
  const RenderGroup group{array_stages.get(),
                          {given.table.view(), static_cast<std::uint32_t>(count), row_stride(count)}};
  const BufferView<float> v_params = to.table.view();
  const ViewLoss loss = view_loss(device, *array_stages, renderer, std::span(&group, 1),
                                  std::span(&v_params, 1), scene.camera, target, {}, 0.2f, {});
  to.download(found);

  Errors errors{std::abs(loss.loss - rows.loss)};
  const auto compare = [&](const std::vector<float>& result, const std::vector<float>& reference) {
    const std::vector<double> exact(reference.begin(), reference.end());
    errors.gradient = std::max(errors.gradient, test::relative_error(result, exact));
  };
  compare(found.means, expected.means);
  compare(found.quats, expected.quats);
  compare(found.scales, expected.scales);
  compare(found.opacities, expected.opacities);
  compare(found.colours, expected.colours);  // the unused ones keep their values
  return errors;
}

bool has_addresses(Device& device) {
  return Buffer<float>(device, "test", 1).view().memory->address().pointer != nullptr;
}

TEST_CASE("Gaussians in arrays of the program are rendered and differentiated like rows") {
  for (const auto& device : devices_under_test()) {
    if (!has_addresses(*device)) continue;
    for (const RasterKind raster : rasters_of(*device))
      for (const ColourMode colour :
           {ColourMode::rgb, ColourMode::sh0, ColourMode::sh1, ColourMode::sh2, ColourMode::sh3}) {
        if (on_host(*device) && colour != ColourMode::sh3) continue;
        const Errors errors = errors_of(*device, raster, colour, 37, colour == ColourMode::sh1 ? 5 : 0);
        INFO(device->info().name << ", colour " << static_cast<int>(colour) << ": " << errors.loss << ", "
                                 << errors.gradient);
        // GPUs may round differently in the two programs.
        const bool cpu = device->info().type == DeviceType::cpu || on_host(*device);
        CHECK(errors.loss < (cpu ? 3e-8 : 1e-6));
        CHECK(errors.gradient < (cpu ? 1.3e-6 : 2e-5));
      }
  }
}

TEST_CASE("Gaussians in arrays have the same gradient with every vector width") {
  if (opencl_devices_under_test().empty()) return;
  const std::vector<DeviceInfo> devices = opencl::list_devices();
  for (std::size_t i = 0; i < devices.size(); ++i)
    for (const unsigned width : {16u, 8u, 4u, 1u}) {
      const auto device = opencl::open_device(i, width);
      if (!has_addresses(*device)) continue;
      const Errors errors = errors_of(*device, RasterKind::gpu, ColourMode::sh2, 21, 0);
      INFO(devices[i].name << ", width " << width << ": " << errors.loss << ", " << errors.gradient);
      CHECK(errors.loss < 3e-8);
      CHECK(errors.gradient < 1.3e-6);
    }
}

}  // namespace
}  // namespace ubs
