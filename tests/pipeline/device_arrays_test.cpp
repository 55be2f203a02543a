// SPDX-License-Identifier: Apache-2.0
// Tests the arrays of a renderer in device memory (ubs_renderer_get_array): their values are bit-identical to
// those of the functions that copy results to the host. This test can read the arrays of PoCL's CPU devices
// and of the CUDA back end on the host, but not those in the memory of a GPU.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <vector>

#include "host/base/philox.hpp"
#include "include/ubs/ubs.hpp"

namespace ubs {
namespace {

constexpr int kWidth = 37, kHeight = 21;

ubs_camera camera_of(int width = kWidth, int height = kHeight) {
  auto camera = sized<ubs_camera>();
  for (int i = 0; i < 3; ++i) camera.world_to_camera[5 * i] = 1;
  camera.fx = camera.fy = 30;
  camera.cx = width / 2.0, camera.cy = height / 2.0;
  camera.width = width, camera.height = height;
  return camera;
}

Model splats(std::uint64_t seed) {
  Model model(Settings().set("dim", 6), 70);
  const CounterRandom random(seed, 1);
  std::uint32_t at = 0;
  for (const Parameter& p : model.parameters())
    for (float& v : p.values) v = static_cast<float>(random.uniform(at++, 0, -0.5, 0.5));
  for (float& z : model.parameter("xyz").row(2)) z += 3;
  for (float& z : model.parameter("mean").row(2))
    z += 1;  // the mean direction is +z, so that the camera sees the splats from this direction
  for (float& v : model.parameter("opacity").values) v += 2;
  for (float& v : model.parameter("scale").values) v -= 0.5f;
  return model;
}

// Returns the values in the order of the shape.
std::vector<float> values_of(const ubs_array& array) {
  std::vector<float> values;
  const std::int64_t planes = array.dims == 3 ? array.shape[2] : 1;
  for (std::int64_t i = 0; i < array.shape[0]; ++i)
    for (std::int64_t j = 0; j < array.shape[1]; ++j)
      for (std::int64_t k = 0; k < planes; ++k)
        values.push_back(array.values[i * array.strides[0] + j * array.strides[1] + k * array.strides[2]]);
  return values;
}

void write(const ubs_array& array, const std::vector<float>& values) {
  auto from = values.begin();
  const std::int64_t planes = array.dims == 3 ? array.shape[2] : 1;
  for (std::int64_t i = 0; i < array.shape[0]; ++i)
    for (std::int64_t j = 0; j < array.shape[1]; ++j)
      for (std::int64_t k = 0; k < planes; ++k)
        array.values[i * array.strides[0] + j * array.strides[1] + k * array.strides[2]] = *from++;
}

std::vector<float> values_of(const Model& model) {
  std::vector<float> all;
  for (const Parameter& p : model.parameters()) all.insert(all.end(), p.values.begin(), p.values.end());
  return all;
}

// Gaussians in arrays. gaussian_arrays_test.cpp tests their values.
struct Gaussians {
  std::vector<float> means, quats, scales, opacities, colours;
  explicit Gaussians(std::size_t count, float value = 0)
      : means(3 * count, value),
        quats(4 * count, value),
        scales(3 * count, value),
        opacities(count, value),
        colours(12 * count, value) {}
  ubs_gaussians to_c() {
    auto c = sized<ubs_gaussians>();
    c.count = opacities.size();
    c.means = means.data(), c.quats = quats.data(), c.scales = scales.data();
    c.opacities = opacities.data(), c.colours = colours.data(), c.bases = 4;
    return c;
  }
};

template <typename Action>
void check_usage(const std::string& part, const Action& action) {
  try {
    action();
    FAIL("there was no error, but one with '" << part << "' was expected");
  } catch (const Exception& error) {
    CHECK(error.status() == UBS_ERROR_USAGE);
    CHECK(std::string(error.what()).find(part) != std::string::npos);
  }
}

TEST_CASE("arrays of a renderer in device memory equal the copied values") {
  // The list of the library is used instead of devices_under_test(), because the names in internal headers
  // collide with those in ubs.hpp.
  for (const ubs_device_info& device : Device::list()) {
    INFO(device.name);
    // The back end is part of the name, because both back ends may list the same GPU.
    const Device opened(std::string(device.backend) + ":" + device.name);
    const Model model = splats(1), other = splats(2), gradient(model);
    Renderer renderer(opened, model, UBS_RENDER_GRADIENTS), flat(opened, model, UBS_RENDER_DEPTH);
    const bool pocl_cpu =
        std::string(device.platform) == "Portable Computing Language" && device.type == UBS_DEVICE_CPU;
    if (std::string(device.backend) == "opencl" && !pocl_cpu) {
      check_usage("does not provide addresses", [&] { renderer.array(UBS_ARRAY_PARAMETERS); });
      continue;
    }
    check_usage("nothing has been rendered yet", [&] { renderer.array(UBS_ARRAY_RGB); });
    const ubs_array parameters = renderer.array(UBS_ARRAY_PARAMETERS);
    CHECK(parameters.shape[1] == 70);
    if (parameters.type != 1) continue;  // the values are in the memory of a GPU, which this test cannot read
    CHECK(values_of(parameters) == values_of(model));

    const Picture picture = flat.draw(camera_of());
    const auto nothing = sized<ubs_image>();
    const ubs_camera camera = camera_of();
    check(ubs_renderer_draw(flat.get(), &camera, &nothing));
    CHECK(values_of(flat.array(UBS_ARRAY_RGB)) == picture.rgb);
    CHECK(values_of(flat.array(UBS_ARRAY_DEPTH)) == picture.depth);
    std::vector<float> alpha = values_of(flat.array(UBS_ARRAY_TRANSMITTANCE));
    for (float& a : alpha) a = 1.0f - a;
    CHECK(alpha == picture.alpha);
    CHECK(*std::ranges::max_element(alpha) > 0.3f);

    // Overwrites the parameters with those of another model, and compares images and gradients with those of
    // a renderer that was created for this model.
    std::vector<float> v(3 * kWidth * kHeight);
    const CounterRandom random(3, 1);
    for (std::uint32_t i = 0; i < v.size(); ++i) v[i] = static_cast<float>(random.uniform(i, 0, -1, 1));
    Renderer expected(opened, other, UBS_RENDER_GRADIENTS);
    expected.vjp(camera, v, {}, gradient);
    const std::vector<float> wanted = values_of(other);
    for (std::int64_t row = 0; row < parameters.shape[0]; ++row)
      std::copy_n(wanted.begin() + row * 70, 70, parameters.values + row * parameters.strides[0]);
    CHECK(renderer.draw(camera).rgb == expected.draw(camera).rgb);
    check_usage("no gradient yet", [&] { renderer.array(UBS_ARRAY_GRADIENT); });
    check_usage("pixels", [&] { renderer.array(UBS_ARRAY_V_RGB); });
    const ubs_array v_rgb = renderer.array(UBS_ARRAY_V_RGB, 0, kHeight, kWidth);
    CHECK(values_of(v_rgb) == std::vector<float>(v.size()));
    write(v_rgb, v);
    auto v_image = sized<ubs_image_gradient>();
    v_image.rgb = v_rgb.values;
    const ubs_camera wide = camera_of(kWidth + 1);
    check_usage("37x21", [&] { check(ubs_renderer_vjp(renderer.get(), &wide, &v_image, nullptr)); });
    check(ubs_renderer_vjp(renderer.get(), &camera, &v_image, nullptr));
    CHECK(values_of(renderer.array(UBS_ARRAY_GRADIENT)) == values_of(gradient));
    CHECK(std::ranges::any_of(values_of(gradient), [](float x) { return x != 0; }));

    // The gradient of the parameters depends on UBS_ARRAY_V_MEANS2D, the gradient of the positions in the
    // image. Setting this array to 0 changes the gradient of the parameters, and restoring the array restores
    // it.
    const ubs_array v_means = renderer.array(UBS_ARRAY_V_MEANS2D);
    REQUIRE(v_means.shape[0] == 70);
    REQUIRE(v_means.shape[1] == 2);
    const std::vector<float> moved = values_of(v_means);
    const auto write_means = [&](bool zero) {
      for (std::size_t i = 0; i < 140; ++i)
        v_means.values[static_cast<std::int64_t>(i / 2) * v_means.strides[0] +
                       static_cast<std::int64_t>(i % 2)] = zero ? 0.0f : moved[i];
    };
    write_means(true);
    const std::vector<float> rest = values_of(renderer.array(UBS_ARRAY_GRADIENT));
    CHECK(rest != values_of(gradient));
    write_means(false);
    CHECK(values_of(renderer.array(UBS_ARRAY_GRADIENT)) == values_of(gradient));
    // A splat whose position has a gradient is in the image, so the extents of its ellipse must be positive.
    const std::vector<float> extents = values_of(renderer.array(UBS_ARRAY_EXTENTS));
    int seen = 0;
    for (std::size_t i = 0; i < 140; ++i)
      if (moved[i] != 0) {
        CHECK(extents[i] > 0);
        ++seen;
      }
    CHECK(seen > 20);
    check_usage("group 1 does not exist", [&] { renderer.array(UBS_ARRAY_GRADIENT, 1); });
    check_usage("without UBS_RENDER_DEPTH", [&] { renderer.array(UBS_ARRAY_DEPTH); });
  }
}

// Each gradient may be in an array of the renderer or in host memory, and the other gradients in the other
// kind of memory.
TEST_CASE("gradients of alpha and depth can be written to arrays of a renderer") {
  for (const ubs_device_info& device : Device::list()) {
    INFO(device.name);
    const Device opened(std::string(device.backend) + ":" + device.name);
    const Model model = splats(1), gradient(model);
    Renderer renderer(opened, model, UBS_RENDER_GRADIENTS | UBS_RENDER_DEPTH);
    const bool pocl_cpu =
        std::string(device.platform) == "Portable Computing Language" && device.type == UBS_DEVICE_CPU;
    if (std::string(device.backend) == "opencl" && !pocl_cpu) continue;
    if (renderer.array(UBS_ARRAY_PARAMETERS).type != 1) continue;  // the memory of a GPU
    const ubs_camera camera = camera_of();
    constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
    const CounterRandom random(5, 1);
    std::array<std::vector<float>, 3> v{std::vector<float>(3 * kPixels), std::vector<float>(kPixels),
                                        std::vector<float>(kPixels)};
    for (std::uint32_t k = 0; k < 3; ++k)
      for (std::uint32_t i = 0; i < v[k].size(); ++i)
        v[k][i] = static_cast<float>(random.uniform(i, k, -1, 1));
    std::vector<std::vector<float>> found;
    for (unsigned given = 1; given < 8; ++given) {       // bit k: there is gradient k
      for (unsigned shared = 0; shared < 8; ++shared) {  // bit k: it is in an array
        if (shared & ~given) continue;
        INFO("gradients " << given << ", of which " << shared << " are in arrays");
        auto v_image = sized<ubs_image_gradient>();
        std::array<const float**, 3> members{&v_image.rgb, &v_image.alpha, &v_image.depth};
        constexpr std::array kNames{UBS_ARRAY_V_RGB, UBS_ARRAY_V_ALPHA, UBS_ARRAY_V_DEPTH};
        for (std::size_t k = 0; k < 3; ++k) {
          if (!(given >> k & 1)) continue;
          *members[k] = v[k].data();
          if (!(shared >> k & 1)) continue;
          const ubs_array to = renderer.array(kNames[k], 0, kHeight, kWidth);
          REQUIRE(values_of(to) == std::vector<float>(v[k].size()));
          write(to, v[k]);
          *members[k] = to.values;
        }
        check(ubs_renderer_vjp(renderer.get(), &camera, &v_image, gradient.get()));
        if (shared == 0) found.push_back(values_of(gradient));
        CHECK(values_of(gradient) == found.back());
      }
      for (std::size_t k = 0; k + 1 < found.size(); ++k) CHECK(found[k] != found.back());
    }
  }
}

TEST_CASE("a renderer reads Gaussians from arrays of the program") {
  for (const ubs_device_info& device : Device::list()) {
    INFO(device.name);
    const Device opened(std::string(device.backend) + ":" + device.name);
    Settings settings;
    settings.set("dim", 3).set("kernel", "gaussian").set("rot_mode", "quaternion").set("colour", "sh1");
    const Model model(settings, 1);
    const unsigned flags = UBS_RENDER_GAUSSIANS | UBS_RENDER_GRADIENTS;
    const ubs_camera camera = camera_of();
    const bool pocl_cpu =
        std::string(device.platform) == "Portable Computing Language" && device.type == UBS_DEVICE_CPU;
    check_usage("requires a model", [&] { Renderer(opened, splats(1), flags); });
    if (std::string(device.backend) == "opencl" && !pocl_cpu) {
      check_usage("does not provide addresses", [&] { Renderer(opened, model, flags); });
      continue;
    }
    Renderer renderer(opened, model, flags), plain(opened, model, UBS_RENDER_GRADIENTS);
    check_usage("no Gaussians yet", [&] { renderer.draw(camera); });
    const std::vector<float> v(3 * kWidth * kHeight, 1.0f);
    if (renderer.array(UBS_ARRAY_V_RGB, 0, kHeight, kWidth).type != 1) continue;  // the memory of a GPU

    Gaussians given(3), gradient(3, 7);
    for (std::size_t i = 0; i < 3; ++i) {
      given.means[3 * i] = 0.2f * static_cast<float>(i), given.means[3 * i + 2] = 3;
      given.quats[4 * i] = 1;
      given.opacities[i] = 0.5f;
      for (std::size_t k = 0; k < 3; ++k) given.scales[3 * i + k] = 0.3f, given.colours[12 * i + k] = 1;
    }
    renderer.set_gaussians(given.to_c());
    check_usage("no gradient yet", [&] { renderer.get_gaussian_gradients(gradient.to_c()); });
    const Picture three = renderer.draw(camera);
    CHECK(*std::ranges::max_element(three.alpha) > 0.5f);
    renderer.vjp(camera, v, {}, nullptr);
    renderer.get_gaussian_gradients(gradient.to_c());
    for (const float g : gradient.opacities) CHECK((g > 0 && g != 7));
    CHECK(std::ranges::count(gradient.colours, 7.0f) == 0);
    const std::vector<float> means2d = values_of(renderer.array(UBS_ARRAY_MEANS2D));
    REQUIRE(means2d.size() == 6);
    CHECK(means2d[2] == Approx(kWidth / 2.0 + 30 * 0.2 / 3).epsilon(1e-5));
    CHECK(values_of(renderer.array(UBS_ARRAY_OPACITIES)) == std::vector<float>(3, 0.5f));
    const ubs_array depths = renderer.array(UBS_ARRAY_DEPTHS);
    CHECK(depths.dims == 1);
    CHECK(depths.values[2 * depths.strides[0]] == 3);

    Gaussians one(1);  // another number of Gaussians, of opacity 0
    one.quats[0] = one.scales[0] = one.scales[1] = one.scales[2] = 1;
    renderer.set_gaussians(one.to_c());
    CHECK(renderer.draw(camera).alpha == std::vector<float>(kWidth * kHeight));
    renderer.vjp(camera, v, {}, nullptr);
    check_usage("count = 3 and bases = 4, but the rendered Gaussians have count = 1",
                [&] { renderer.get_gaussian_gradients(gradient.to_c()); });
    renderer.set_gaussians(Gaussians(0).to_c());
    CHECK(renderer.draw(camera).alpha == std::vector<float>(kWidth * kHeight));

    ubs_gaussians wrong = given.to_c();
    wrong.bases = 3;
    check_usage("bases is 3, but must be from 4", [&] { renderer.set_gaussians(wrong); });
    wrong.bases = 4, wrong.quats = nullptr;
    check_usage("an array is NULL", [&] { renderer.set_gaussians(wrong); });
    check_usage("without UBS_RENDER_GAUSSIANS", [&] { plain.set_gaussians(given.to_c()); });
    check_usage("not available with UBS_RENDER_GAUSSIANS", [&] { renderer.update(model); });
    check_usage("not available with UBS_RENDER_GAUSSIANS", [&] { renderer.array(UBS_ARRAY_PARAMETERS); });
    check_usage("not available with UBS_RENDER_GAUSSIANS", [&] { renderer.loss(camera, v, 0.2f); });
    check_usage("not available with UBS_RENDER_GAUSSIANS", [&] { renderer.vjp(camera, v, {}, model); });
  }
}

}  // namespace
}  // namespace ubs
