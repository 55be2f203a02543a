// SPDX-License-Identifier: Apache-2.0
// Tests the reduction of small models on every device and rasteriser: lossless reduction does not change the
// training views, and lossy reduction changes no view by more than its bound.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "host/base/error.hpp"
#include "host/model/reducer.hpp"
#include "kernels/layout.h"
#include "tests/reduce/reduce_scene.hpp"
#include "tests/support/device_fixture.hpp"

using namespace ubs;
using namespace ubs::test;
using namespace ubs::reduce;

namespace {

// A model on a device, and a renderer for all cameras of the scene.
struct Drawn {
  DeviceGroups groups;
  Renderer renderer;
  Drawn(Device& device, const MixedModel& model, const KernelConfig& config,
        const std::vector<Camera>& cameras)
      : groups(device, model, config), renderer(device, groups.stages()) {
    renderer.set_cameras(cameras);
  }
  RenderedView draw(std::uint32_t view) {
    renderer.forward(groups.view(), view, settings(), false);
    return renderer.download();
  }
  // Returns settings with a sky that is red on one side.
  static RenderSettings settings() {
    RenderSettings settings{.background = {0.2f, 0.1f, 0.9f}};
    settings.sky = {0.2f, 0.1f, 0.9f};
    (*settings.sky)[9] = 1;
    return settings;
  }
};

// MarkedView is a rendered view of a model. `changed` contains for each pixel the sum of T alpha over the
// marked splats, where T is the transmittance in front of a splat. `left` is the transmittance after the last
// splat. The colours of the splats in the view range from `low` to `high`.
struct MarkedView {
  std::vector<float> image, changed, left;
  float low = 0, high = 0;
};

// Renders a view of the model in which the splats with changed[i] == true are marked.
MarkedView draw_marked(Device& device, Drawn& drawn, std::uint32_t view, const std::vector<bool>& changed) {
  drawn.renderer.forward(drawn.groups.view(), view, Drawn::settings(), false);
  const RasterForward lists = drawn.renderer.last_lists();
  const ImageShape shape = lists.shape;
  MarkedView out;
  out.image = cropped_planes(read_values(device, lists.image, 3 * shape.plane()), shape);
  std::vector<float> records = read_values(device, lists.records, changed.size() * kSplatStride);
  const auto tiles = read_values(device, drawn.renderer.tile_counts(), changed.size());
  for (std::size_t i = 0; i < changed.size(); ++i) {
    float* const colour = &records[i * kSplatStride + kSplatR];
    if (tiles[i] > 0)
      for (int c = 0; c < 3; ++c)
        out.low = std::min(out.low, colour[c]), out.high = std::max(out.high, colour[c]);
    std::fill_n(colour, 3, changed[i] ? 1.0f : 0.0f);
  }
  device.write(*lists.records.memory, 0, std::as_bytes(std::span(records)));
  drawn.renderer.draw_again();
  out.changed = cropped_planes(read_values(device, lists.image, 3 * shape.plane()), shape);
  std::vector<float> left = read_values(device, lists.transmittance, shape.plane());
  left.resize(3 * shape.plane());
  out.left = cropped_planes(left, shape);
  return out;
}

struct ChangeOfViews {
  double measured = 0, bound = 0;  // the largest change of a value, and the largest bound of a value
  std::size_t beyond = 0;          // number of values that change by more than their own bound
};

// Compares the views of the models before and after the reduction.
//
// Derivation of the bound of a pixel: let T_j be the transmittance in front of splat j at the pixel, a_j its
// alpha, c_j its colour, and B_j the colour of everything behind it. Removing j changes the pixel by T_j a_j
// (B_j - c_j). If splats are removed from back to front, no removal changes T of a splat that is removed
// later, and B_j is always a mean of colours of splats and background. Let G be the range of these colours,
// and D the sum of T_j a_j over the removed splats. Then the pixel changes by at most G D. A splat whose
// dimensions are reduced counts as removed from the model before the reduction and added to the model after
// it, so D is the sum over both models. If blending stops at this pixel in one of the images, at the
// transmittance T_stop <= 0.1, it may continue in the other image. Then the change is at most G (2 D +
// T_stop).
ChangeOfViews change_of(Device& device, const KernelConfig& config, const ReduceScene& scene, Drawn& before,
                        const Reduced& reduced) {
  constexpr double kRounding = 1e-5;  // rounding of float32, in both images
  constexpr float kSky = 0.6308f;     // largest value of the sky's harmonic, whose coefficient is 1
  Drawn after(device, reduced.model, config, scene.cameras);
  std::vector<bool> gone(reduced.new_index.size()), come(reduced.model.count());
  for (std::size_t i = 0; i < gone.size(); ++i) {
    gone[i] = reduced.new_index[i] == kGone || reduced.turned[i];
    if (reduced.new_index[i] != kGone) come[reduced.new_index[i]] = reduced.turned[i];
  }
  ChangeOfViews out;
  for (std::uint32_t v = 0; v < scene.cameras.size(); ++v) {
    const MarkedView a = draw_marked(device, before, v, gone), b = draw_marked(device, after, v, come);
    const double range = std::max({a.high, b.high, 0.9f + kSky}) - std::min({a.low, b.low, 0.1f - kSky});
    const std::size_t pixels = a.image.size() / 3;
    for (std::size_t i = 0; i < a.image.size(); ++i) {
      const std::size_t p = i % pixels;
      const double d = double{a.changed[p]} + b.changed[p],
                   stop = std::max(a.left[p] <= 0.1f ? a.left[p] : 0, b.left[p] <= 0.1f ? b.left[p] : 0);
      const double bound = d > 0 || stop > 0 ? range * (stop > 0 ? 2 * d + stop : d) + kRounding : 0;
      const double measured = std::abs(double{a.image[i]} - b.image[i]);
      out.measured = std::max(out.measured, measured);
      out.bound = std::max(out.bound, bound);
      out.beyond += !(measured <= bound);
    }
  }
  return out;
}

template <typename Function>
void for_each_case(const Function& function) {
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device))
      for (const int dim : {6, 7})
        DYNAMIC_SECTION(device->info().name << (raster == RasterKind::cpu ? " cpu" : " gpu")
                                            << " N = " << dim) {
          function(*device, KernelConfig{.dim = dim, .raster = raster}, ReduceScene(dim));
        }
}

}  // namespace

TEST_CASE("smaller_dims() returns the dimensions to which a splat can be reduced", "[reduce]") {
  CHECK(smaller_dims(3).empty());
  CHECK(smaller_dims(4) == std::vector<int>{3});
  CHECK(smaller_dims(6) == std::vector<int>{3});
  CHECK(smaller_dims(7) == std::vector<int>{3, 4, 6});
  CHECK(smaller_dims(8) == std::vector<int>{3, 5, 6});
  // Time and two further values without the direction would also be N = 6, which means the direction alone.
  CHECK(smaller_dims(9) == std::vector<int>{3, 6});
}

TEST_CASE("lossless reduction does not change the training views", "[reduce]") {
  for_each_case([](Device& device, const KernelConfig& config, const ReduceScene& scene) {
    Drawn before(device, scene.model, config, scene.cameras);
    const Contributions contributions = measure_contributions(device, before.renderer, before.groups,
                                                              Drawn::settings(), ReduceScene::kTraining);
    const Reducer reducer(scene.model, scene.training(), contributions, 0.3, 0);
    const Reduced reduced = reducer.reduce(0);
    CHECK(reduced.unseen >= 2 * ReduceScene::kEach);
    CHECK(reduced.unseen < 4 * ReduceScene::kEach);
    CHECK(reduced.inert > ReduceScene::kEach / 2);
    CHECK((reduced.dropped == 0 && reduced.turned_count == 0));
    CHECK(reduced.model.groups.back().dim == 3);
    if (config.dim == 7) CHECK(reduced.model.groups[1].dim == 6);

    Drawn after(device, reduced.model, config, scene.cameras);
    for (std::uint32_t v = 0; v < ReduceScene::kTraining; ++v) {
      const RenderedView a = before.draw(v), b = after.draw(v);
      // For N = 6, all bits must be equal on CPUs. For N = 7, splats on which the time has no effect become
      // 6-D, and are rounded differently, because the pivots of their query factors differ. On GPUs (H200,
      // CUDA), the kernels for N = 3 and N = 6 also round differently.
      const bool real_card = device.info().type == DeviceType::gpu && !on_host(device);
      const bool keeps_bits = config.dim < 7 && !real_card;
      CHECK((!keeps_bits || (a.rgb == b.rgb && a.alpha == b.alpha)));
      double worst = 0;
      for (std::size_t i = 0; i < a.rgb.size(); ++i)
        worst = std::max(worst, std::abs(static_cast<double>(a.rgb[i]) - static_cast<double>(b.rgb[i])));
      CHECK(worst <= 3.6e-7);  // the largest differences observed on PoCL are 0 (N = 6) and 1.8e-7 (N = 7)
    }
    // Each of the remaining splats must have an effect on an image.
    for (std::size_t i = 0; i < scene.model.count(); ++i)
      CHECK((reduced.new_index[i] == kGone) == (contributions.most[i] == 0));
  });
}

TEST_CASE("lossy reduction stays within its bound on all views", "[reduce][opencv]") {
  for_each_case([](Device& device, const KernelConfig& config, const ReduceScene& scene) {
    Drawn before(device, scene.model, config, scene.cameras);
    const Contributions contributions = measure_contributions(device, before.renderer, before.groups,
                                                              Drawn::settings(), ReduceScene::kTraining);
    const Reducer reducer(scene.model, scene.training(), contributions, 0.3, 1);
    std::size_t parameters = scene.model.parameters() + 1;
    for (const double weight : {0.01, 0.1, 0.4}) {
      const Reduced reduced = reducer.reduce(weight);
      CHECK(reduced.model.parameters() < parameters);
      parameters = reduced.model.parameters();
      INFO("weight bound " << weight);
      const ChangeOfViews change = change_of(device, config, scene, before, reduced);
      CHECK(change.beyond == 0);
      CHECK(change.measured > 0);
      const Reduced dropped = reducer.reduce(weight, {.dimensions = false});
      CHECK(change_of(device, config, scene, before, dropped).beyond == 0);
    }
    const Reduced turned = reducer.reduce(0.4, {.splats = false});
    CHECK(turned.dropped == 0);
    CHECK(turned.turned_count > 0);
    CHECK(turned.model.count() == scene.model.count());
    // If splats with reduced dimensions are not marked, their bound is 0 and must be exceeded. This shows
    // that the check can fail.
    Reduced unaware = turned;
    std::ranges::fill(unaware.turned, std::uint8_t{0});
    CHECK(change_of(device, config, scene, before, unaware).beyond > 0);
  });
}
