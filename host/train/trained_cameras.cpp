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
  std::vector<FittedCamera> out;
  for (std::size_t i = 0; i < split.views.size(); ++i) {
    const Camera& camera = cameras[first + i];
    out.push_back(fit_camera(drawing, split.views[i].load_image(), camera, pivot_depth(camera, model), fits));
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
  measure_from(device_, stages_, passes_.renderer(), std::span(&splats, 1), passes_.settings(), cameras,
               views_.targets(), static_cast<std::uint32_t>(views_.train().views.size()), metrics);
  restore_cameras();
}

}  // namespace ubs
