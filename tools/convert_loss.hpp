// SPDX-License-Identifier: Apache-2.0
// measure_loss() measures what an exported file has lost: it renders the model and the file from cameras that
// the model lists, and compares the images. It needs no data.
#pragma once

#include <optional>
#include <string>

#include "host/data/splat_file.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs::tools {

struct ExportLoss {
  // PSNR of the file against the model, mean over the cameras, at most 100 [dB]. For `own`, both are rendered
  // in front of the background of the model. For `black`, both are rendered in front of black, because most
  // programs show the file in this way.
  double own = 0, black = 0;
  std::size_t cameras = 0;
};

// Returns whether a file of this format stores the model exactly.
bool exports_exactly(const SplatFormat& format, const MixedModel& model);

// Measures at most kLossCameras of the cameras that the model lists, reduced to kLossPixels. `written` is the
// file as it is read again; it is rendered as other programs render Gaussians. A model that depends on time
// is rendered at `time`. Returns nothing if the model lists no cameras.
inline constexpr std::size_t kLossCameras = 4;
inline constexpr int kLossPixels = 800;  // longer side
std::optional<ExportLoss> measure_loss(const std::string& device, const LoadedModel& loaded,
                                       const MixedModel& written, TrainSettings settings, double time);

}  // namespace ubs::tools
