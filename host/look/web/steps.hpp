// SPDX-License-Identifier: Apache-2.0
// pack_for_web() compresses a model by rounding its parameters (host/formats/ubsz.hpp). It chooses the
// quantisation steps so that the images of a set of cameras keep a given PSNR against those of the exact
// model.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/formats/ubsz.hpp"
#include "host/model/model_session.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::web {

struct ViewPsnr {
  // Mean and minimum over the views of the joint PSNR, with pixels clamped to [0, 1] [dB].
  double mean = 0, worst = 0;
};

// PackedForWeb is a compressed model with its quality.
struct PackedForWeb {
  std::vector<std::byte> bytes;
  ViewPsnr psnr;
  // Only for files with levels: the size, the number of splats and the PSNR of the file up to the end of a
  // level.
  struct Level {
    std::size_t bytes = 0, splats = 0;
    ViewPsnr psnr;
  };
  std::vector<Level> levels;
};
inline constexpr double kPsnr = 50;  // default of `psnr` [dB]
// Compresses a model. The quantisation steps are chosen as follows. The rounding errors of the parameters are
// assumed to be independent. With steps d, the squared error of the images is then the sum of H d^2 / 12 over
// all parameters. H of a parameter is the sum of the squared derivatives of all pixels with respect to this
// parameter. H is estimated from up to 48 views, with one backward pass per view, in which the pixel
// gradients are randomly +1 or -1. Every row of parameters gets an equal share of the error, which is optimal
// if an entropy coder follows. Splats that affect the images less have steps that are 2^k times as large.
// Finally, all steps are scaled until the mean PSNR of the images of all views is at least `psnr`. If this is
// not possible, pack_for_web() throws Error(usage). `levels` is the maximum number of levels of the file, and
// `note` receives messages about the progress.
PackedForWeb pack_for_web(
    std::shared_ptr<Device> device, const MixedModel& model, const std::vector<std::string>& comments,
    const std::vector<Camera>& cameras, const TrainSettings& settings, double psnr = kPsnr, int levels = 1,
    const std::function<void(const std::string&)>& note = [](const std::string&) {});

inline constexpr int kLongestPoster = 640;  // maximum length of the longer side of a poster in a page [px]
// draw_poster() renders the still image that a page shows until its first frame. poster_uri() converts it to
// a data URI that is small enough for the page.
Image8 draw_poster(const std::shared_ptr<Device>& device, const MixedModel& model,
                   const TrainSettings& settings, const Camera& camera);
std::string poster_uri(const Image8& still);

}  // namespace ubs::web
