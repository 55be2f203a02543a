// SPDX-License-Identifier: Apache-2.0
// Tests the unit of a scene (the setting `unit`): if all lengths of a model, of its cameras and of the
// clipping planes are multiplied by the same factor, the images do not change, and the depth at which cameras
// see points is multiplied by this factor.
#include "host/scene/scene_unit.hpp"

#include <catch2/catch.hpp>

#include "host/base/philox.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/variants.hpp"

namespace ubs {
namespace {

constexpr double kFactors[] = {1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6};

RenderedView drawn(Device& device, const test::NamedVariant& form, const SplatModel& model,
                   const Camera& camera, double unit) {
  const auto stages = make_stages(device, {.dim = form.dim, .depth = true, .variant = form.variant});
  const DeviceModel on_device(device, model);
  Renderer renderer(device, *stages);
  renderer.set_cameras({camera});
  RenderSettings settings;
  settings.projection.near_plane = static_cast<float>(0.01 * unit);
  settings.projection.far_plane = static_cast<float>(1e10 * unit);
  renderer.forward(on_device.view(), 0, settings, false);
  return renderer.download();
}

double largest_difference(const std::vector<float>& a, const std::vector<float>& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(double{a[i]} - b[i]));
  return largest;
}

// Returns the depth times alpha of each pixel, in multiples of `unit`. The depth itself is not compared,
// because at nearly transparent pixels it is a quotient of two small numbers.
std::vector<float> depths(const RenderedView& view, double unit) {
  std::vector<float> out = view.depth;
  for (std::size_t i = 0; i < out.size(); ++i) out[i] *= static_cast<float>(view.alpha[i] / unit);
  return out;
}

TEST_CASE("unit: a scaled model gives the same images", "[unit]") {
  std::vector<test::NamedVariant> forms = test::named_variants();
  forms.insert(forms.begin(), {{"default", 6, {}}, {"default", 7, {}}, {"default", 4, {}}});
  for (const auto& device : devices_under_test())
    for (const test::NamedVariant& form : forms) {
      if (!has_free_unit(form.variant)) continue;
      const oracle::Scene scene =
          oracle::regular_scene({.count = 200, .dim = form.dim, .variant = form.variant});
      const RenderedView expected = drawn(*device, form, scene.model, scene.camera, 1);
      for (const double factor : kFactors) {
        INFO(describe(device->info()) << ", " << form.name << " " << form.dim << ", times " << factor);
        SplatModel model = scene.model;
        Camera camera = scene.camera;
        scale_lengths(model, factor);
        scale_lengths(camera, factor);
        const RenderedView found = drawn(*device, form, model, camera, factor);
        CHECK(largest_difference(expected.rgb, found.rgb) < 2e-4);
        CHECK(largest_difference(depths(expected, 1), depths(found, factor)) < 4e-4);
        scale_lengths(model, 1 / factor);
        CHECK(largest_difference(scene.model.values, model.values) < 1e-5);
      }
    }
}

TEST_CASE("unit: the median depth of points is proportional to the size of the scene", "[unit]") {
  std::vector<Camera> cameras;
  for (int i = 0; i < oracle::kRingCameras; ++i) cameras.push_back(oracle::ring_camera({}, i));
  PointCloud points;
  const CounterRandom random(5, 1);
  for (std::uint32_t i = 0; i < 500; ++i)
    points.positions.push_back({static_cast<float>(random.uniform(i, 0, -0.5, 0.5)),
                                static_cast<float>(random.uniform(i, 1, -0.5, 0.5)),
                                static_cast<float>(random.uniform(i, 2, -0.5, 0.5))});
  const double depth = median_depth(cameras, points).value();
  CHECK(depth == Approx(3).epsilon(0.05));  // the radius of the ring
  for (const double factor : kFactors) {
    std::vector<Camera> scaled = cameras;
    for (Camera& camera : scaled) scale_lengths(camera, factor);
    PointCloud scaled_points = points;
    scale_lengths(scaled_points, factor);
    CHECK(median_depth(scaled, scaled_points).value() == Approx(factor * depth).epsilon(1e-6));
  }
  // An additional camera far away changes the median only a little.
  cameras.push_back(cameras[0]);
  for (double& value : cameras.back().translation) value *= 10;
  CHECK(median_depth(cameras, points).value() == Approx(depth).epsilon(0.02));
  points.positions.resize(5);
  CHECK_FALSE(median_depth(cameras, points));  // a camera must see at least ten points
}

TEST_CASE("unit: lengths in views are divided by the unit, other values are kept", "[unit]") {
  Split split{"train", {}};
  View& view = split.views.emplace_back();
  view.name = "left", view.part_of = "image", view.masked = true, view.opaque = true, view.file = "left.png";
  view.background = std::array{0.1f, 0.2f, 0.3f};
  view.camera = oracle::ring_camera({}, 1);
  view.image = {1, 1, {1, 2, 3}, {}};
  const Split scaled = in_unit(split, 20);
  const View& other = scaled.views.at(0);
  CHECK(other.name == "left");
  CHECK(other.part_of == "image");
  CHECK((other.masked && other.opaque && other.file == "left.png"));
  CHECK(other.background == view.background);
  CHECK(other.load_image().rgb == view.image.rgb);
  CHECK(other.source->held() == &view.image);
  for (std::size_t i = 0; i < 3; ++i) CHECK(20 * other.camera.centre()[i] == Approx(view.camera.centre()[i]));
}

}  // namespace
}  // namespace ubs
