// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "host/check/stage_checks.hpp"

namespace ubs::check {
namespace {

// Maximum absolute error of the values, and maximum relative error of the gradient. docs/check.md links to
// the largest errors that were measured, and to the reasons for these bounds.
constexpr double kValueBound = 1e-6, kImageGradientBound = 1e-5;

void add_values(WorstFinding& worst, const std::vector<float>& sums, const LossValues& expected) {
  worst.add("mean absolute difference", std::abs(sums[0] - expected.l1), kValueBound);
  worst.add("SSIM", std::abs(sums[1] - expected.ssim), kValueBound);
  for (std::size_t c = 0; c < 3; ++c)
    worst.add("mean squared difference", std::abs(sums[2 + c] - expected.mse[c]), kValueBound);
}

}  // namespace

Findings check_loss(Device& device, Stages& stages) {
  const LossVectors& e = embedded_vectors().loss;
  const ImageShape shape{e.width, e.height};
  Buffer<float> image(device, "image", 3 * shape.plane()),
      v_image(device, "image gradient", 3 * shape.plane()), sums(device, "loss sums", 8);
  Buffer<std::uint8_t> target(device, "target image", e.target.size());
  image.upload(padded_planes(rounded(e.image), shape));
  target.upload(e.target);
  ImageLoss loss{.shape = shape,
                 .image = image.view(),
                 .target = target.view(),
                 .weights = loss_weights(static_cast<float>(e.lambda_dssim)),
                 .v_image = v_image.view(),
                 .sums = sums.view()};
  stages.image_loss(loss);
  WorstFinding value("loss"), gradient("gradient of the loss");
  add_values(value, sums.download(), e.values);
  ErrorSum inside, outside;
  const std::vector<float> v = v_image.download();
  for (std::size_t c = 0, i = 0; c < 3; ++c)
    for (int y = 0; y < shape.rows(); ++y)
      for (int x = 0; x < shape.pitch(); ++x) {
        const float found = v[c * shape.plane() + static_cast<std::size_t>(y * shape.pitch() + x)];
        if (y < shape.height && x < shape.width)
          inside.add(found, e.v_image[i++]);
        else
          outside.add(found, 0);
      }
  gradient.add("image gradient", inside.errors().relative, kImageGradientBound);
  gradient.add("gradient in the padding", outside.errors().absolute, 0);
  loss.v_image = {};
  loss.clamp = true;
  stages.image_loss(loss);
  add_values(value, sums.download(), e.clamped);
  return {value.finding(), gradient.finding()};
}

}  // namespace ubs::check
