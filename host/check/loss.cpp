// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "host/accuracy/error_norms.hpp"
#include "host/check/stage_checks.hpp"

namespace ubs::check {
namespace {

// Worst seen, and why there is room above it: docs/check.md.
constexpr double kValueBound = 1e-6, kImageGradientBound = 1e-5;

struct Images {
  ImageShape shape;
  std::vector<double> image, target;       // (3, height, width)
  std::vector<std::uint8_t> target_bytes;  // `target` is of these
};

// The drawn scene, made to leave [0, 1] in places, beside its target in 8 bit.
Images images_of(const Expected& e) {
  Images images{{e.problem.camera.width, e.problem.camera.height}, {}, {}, {}};
  for (const float x : e.stages.image_rounded) images.image.push_back(static_cast<float>(1.6 * x - 0.2));
  for (const float t : e.problem.target) {
    images.target_bytes.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(t, 0.0f, 1.0f))));
    images.target.push_back(static_cast<double>(static_cast<float>(images.target_bytes.back()) / 255.0f));
  }
  return images;
}

struct Values {
  double l1 = 0, ssim = 0, mse[3] = {0, 0, 0};
};

Values values_of(const Images& images, bool clamp) {
  std::vector<double> x = images.image;
  if (clamp)
    for (double& value : x) value = std::clamp(value, 0.0, 1.0);
  Values v;
  const std::size_t pixels = x.size() / 3;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double d = x[i] - images.target[i];
    v.l1 += std::abs(d) / static_cast<double>(x.size());
    v.mse[i / pixels] += d * d / static_cast<double>(pixels);
  }
  v.ssim = oracle::ssim(x, images.target, 3, images.shape.height, images.shape.width);
  return v;
}

void add_values(Worst& worst, const std::vector<float>& sums, const Values& expected) {
  worst.add("mean difference", std::abs(sums[0] - expected.l1), kValueBound);
  worst.add("SSIM", std::abs(sums[1] - expected.ssim), kValueBound);
  for (std::size_t c = 0; c < 3; ++c)
    worst.add("squared difference", std::abs(sums[2 + c] - expected.mse[c]), kValueBound);
}

}  // namespace

Findings check_loss(Device& device, Stages& stages, const Expected& e) {
  const Images images = images_of(e);
  Buffer<float> image(device, "image", 3 * images.shape.plane()),
      v_image(device, "image gradient", 3 * images.shape.plane()), sums(device, "loss sums", 8);
  Buffer<std::uint8_t> target(device, "target image", images.target_bytes.size());
  const std::vector<float> planes(images.image.begin(), images.image.end());
  image.upload(padded_planes(planes, images.shape));
  target.upload(images.target_bytes);
  const double lambda = static_cast<float>(e.problem.lambda_dssim);
  ImageLoss loss{.shape = images.shape,
                 .image = image.view(),
                 .target = target.view(),
                 .lambda_dssim = static_cast<float>(lambda),
                 .v_image = v_image.view(),
                 .sums = sums.view()};
  stages.image_loss(loss);
  Worst value("loss"), gradient("gradient of the loss");
  add_values(value, sums.download(), values_of(images, false));
  const std::vector<double> expected =
      oracle::image_gradient(images.image, images.target, images.shape.width, images.shape.height, lambda);
  accuracy::ErrorSum inside, outside;
  const std::vector<float> v = v_image.download();
  for (std::size_t c = 0, i = 0; c < 3; ++c)
    for (int y = 0; y < images.shape.rows(); ++y)
      for (int x = 0; x < images.shape.pitch(); ++x) {
        const float found =
            v[c * images.shape.plane() + static_cast<std::size_t>(y * images.shape.pitch() + x)];
        if (y < images.shape.height && x < images.shape.width)
          inside.add(found, expected[i++]);
        else
          outside.add(found, 0);
      }
  gradient.add("image gradient", inside.errors().relative, kImageGradientBound);
  gradient.add("image gradient outside of the image", outside.errors().absolute, 0);
  loss.v_image = {};
  loss.clamp = true;
  stages.image_loss(loss);
  add_values(value, sums.download(), values_of(images, true));
  return {value.finding(), gradient.finding()};
}

}  // namespace ubs::check
