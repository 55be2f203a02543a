// SPDX-License-Identifier: Apache-2.0
#include "tools/convert_loss.hpp"

#include <algorithm>
#include <cmath>

#include "host/formats/gaussian_model.hpp"
#include "host/model/distill.hpp"
#include "host/model/model_session.hpp"
#include "host/model/scene_frame.hpp"

namespace ubs::tools {
namespace {

constexpr double kLeastError = 1e-10;  // lower limit of mean squared errors, which corresponds to 100 dB

void reduce_to(Camera& camera, int longest) {
  const int side = std::max(camera.width, camera.height);
  if (side <= longest) return;
  const auto reduced = [&](int pixels) {
    return std::max(1, static_cast<int>(std::lround(static_cast<double>(pixels) * longest / side)));
  };
  const double x = static_cast<double>(reduced(camera.width)) / camera.width,
               y = static_cast<double>(reduced(camera.height)) / camera.height;
  camera.width = reduced(camera.width), camera.height = reduced(camera.height);
  camera.fx *= x, camera.cx *= x, camera.fy *= y, camera.cy *= y;
}

// Renders the model from all cameras, in front of the background of the settings, or in front of black.
std::vector<std::vector<float>> images_of(ModelSession& session, std::size_t cameras, bool black) {
  RenderSettings settings = session.settings();
  if (black) {
    settings.background = {0, 0, 0};
    settings.sky.reset();
  }
  std::vector<std::vector<float>> images;
  for (std::size_t i = 0; i < cameras; ++i) {
    session.renderer().forward(session.model().view(), static_cast<std::uint32_t>(i), settings, false);
    images.push_back(session.renderer().download().rgb);
  }
  return images;
}

double mean_psnr(const std::vector<std::vector<float>>& truth,
                 const std::vector<std::vector<float>>& images) {
  double mean = 0;
  for (std::size_t v = 0; v < truth.size(); ++v) {
    double sum = 0;
    for (std::size_t i = 0; i < truth[v].size(); ++i) {
      const double d = std::clamp(images[v][i], 0.0f, 1.0f) - std::clamp(truth[v][i], 0.0f, 1.0f);
      sum += d * d;
    }
    mean -= 10 * std::log10(std::max(kLeastError, sum / static_cast<double>(truth[v].size())));
  }
  return mean / static_cast<double>(truth.size());
}

}  // namespace

bool loses_in_closed_form(const MixedModel& model) {
  return !std::ranges::all_of(model.groups, is_gaussian_model) || model.variant().lobes() > 0;
}

bool exports_exactly(const SplatFormat& format, const MixedModel& model) {
  return !loses_in_closed_form(model) && !format.rounds &&
         (format.keeps_antialiasing || model.variant().antialias == Antialias::off);
}

LossMeter::LossMeter(std::string device, const LoadedModel& loaded, const TrainSettings& settings,
                     double time)
    : device_(std::move(device)), settings_(settings) {
  std::vector<Camera> cameras =
      evenly_chosen(noted_cameras(loaded.model, loaded.notes.cameras), kLossCameras);
  for (Camera& camera : cameras) {
    if (loaded.model.has_time()) camera.time = time;
    reduce_to(camera, kLossPixels);
    split_.views.push_back({.name = "camera", .camera = camera});
  }
  if (cameras.empty()) return;
  ModelSession session(device_, loaded.model, split_, settings_, false);
  own_ = images_of(session, cameras.size(), false);
  black_ = images_of(session, cameras.size(), true);
}

ExportLoss LossMeter::measure(const MixedModel& written) {
  TrainSettings settings = settings_;
  settings.eps2d = kGaussianBlur;
  ModelSession session(device_, written, split_, settings, false);
  return {mean_psnr(own_, images_of(session, cameras(), false)),
          mean_psnr(black_, images_of(session, cameras(), true))};
}

}  // namespace ubs::tools
