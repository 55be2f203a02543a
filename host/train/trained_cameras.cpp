// SPDX-License-Identifier: Apache-2.0
#include "host/train/trained_cameras.hpp"

namespace ubs {

void TrainedCameras::sweep(double done) {
  const RenderGroup splats = group();
  const double start = time_.seconds();
  views_.sweep_cameras({passes_.renderer(), std::span(&splats, 1), passes_.settings()}, done);
  swept_ += time_.seconds() - start;
  restore_cameras();
}

double TrainedCameras::sweep_seconds(int factor) {
  const RenderGroup splats = group();
  const double seconds = views_.refiner()->sweep_seconds(
      {passes_.renderer(), std::span(&splats, 1), passes_.settings()}, factor);
  restore_cameras();
  return seconds;
}

std::vector<FittedCamera> TrainedCameras::fit(const Split& split, std::size_t first, bool fits) {
  const RenderGroup splats = group();
  const Drawing drawing{passes_.renderer(), std::span(&splats, 1), passes_.settings()};
  const SplatModel model = splats_.download();
  const std::vector<Camera> cameras = views_.cameras();
  std::vector<FittedCamera> out(split.views.size());
  for (const auto& views : views_by_image(split.views)) {
    const std::vector<Part> parts = parts_of(split, views, std::span(cameras).subspan(first));
    const FittedCamera fitted = fit_camera(drawing, parts, pivot_depth(parts[0].camera, model), fits);
    const std::vector<Camera> found = cameras_of_parts(fitted.camera, parts);
    for (std::size_t k = 0; k < views.size(); ++k) out[views[k]] = {found[k], fitted.deviation};
  }
  restore_cameras();
  return out;
}

const std::vector<FittedCamera>& TrainedCameras::held_out() {
  if (held_out_.empty()) held_out_ = fit(views_.test(), views_.train().views.size(), true);
  return held_out_;
}

void TrainedCameras::measure_fitted(Metrics& metrics) {
  const RenderGroup splats = group();
  std::vector<Camera> cameras;
  for (const FittedCamera& fitted : held_out()) cameras.push_back(fitted.camera);
  measure_from(device_, stages_, passes_.renderer(), std::span(&splats, 1), passes_.settings(),
               views_.test().views, cameras, views_.targets(),
               static_cast<std::uint32_t>(views_.train().views.size()), metrics);
  restore_cameras();
}

}  // namespace ubs
