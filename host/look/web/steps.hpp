// SPDX-License-Identifier: Apache-2.0
// How coarsely a model may be rounded (host/data/ubsz.hpp) so that its pictures stay within a stated PSNR of
// the exact ones, over a set of cameras.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/api/model_session.hpp"
#include "host/data/ubsz.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::web {

struct ViewPsnr {
  double mean = 0, worst = 0;  // over the views, of the joint error of pixels clamped to [0, 1] [dB]
};

// The error that rounding a parameter makes is taken as independent: with steps d the squared error of the
// pictures is sum H d^2 / 12, H the sum of squares of the derivatives of all pixels. H of every parameter
// comes from one backward pass a view whose pixels have gradients of +1 or -1 by chance. Every row gets an
// equal part of the error, which is best where an entropy coder follows; splats that the pictures need less
// have steps 2^k times as large. Then all steps are scaled until the drawn pictures of all views keep `psnr`
// in the mean.
struct PackedForWeb {
  std::vector<std::byte> bytes;
  ViewPsnr psnr;
  // With levels: how many bytes, splats and what error has the file up to the end of each.
  struct Level {
    std::size_t bytes = 0, splats = 0;
    ViewPsnr psnr;
  };
  std::vector<Level> levels;
};
inline constexpr double kPsnr = 50;  // [dB]
PackedForWeb pack_for_web(
    std::shared_ptr<Device> device, const MixedModel& model, const std::vector<std::string>& comments,
    const std::vector<Camera>& cameras, const TrainSettings& settings, double psnr = kPsnr, int levels = 1,
    const std::function<void(const std::string&)>& note = [](const std::string&) {});

}  // namespace ubs::web
