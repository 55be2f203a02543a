// SPDX-License-Identifier: Apache-2.0
// LossMeter measures the loss of quality of an exported file: it renders the model and the file from cameras
// that the model lists, and compares the images. It needs no data.
#pragma once

#include <string>
#include <vector>

#include "host/formats/splat_file.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs::tools {

struct ExportLoss {
  // PSNR of the file against the model, mean over the cameras, at most 100 [dB]. For `own`, both are rendered
  // in front of the background of the model. For `black`, both are rendered in front of black, because most
  // programs show the file in this way.
  double own = 0, black = 0;
};

// Returns whether the conversion to Gaussians changes the model, apart from rounding.
bool loses_in_closed_form(const MixedModel& model);
// Returns whether a file of this format stores the model exactly.
bool exports_exactly(const SplatFormat& format, const MixedModel& model);

// Compares at most kLossCameras of the cameras that the model lists, reduced to kLossPixels.
inline constexpr std::size_t kLossCameras = 4;
inline constexpr int kLossPixels = 800;  // longer side
class LossMeter {
 public:
  // Renders the model. A model that depends on time is rendered at `time`.
  LossMeter(std::string device, const LoadedModel& loaded, const TrainSettings& settings, double time);
  std::size_t cameras() const { return split_.views.size(); }  // 0: the model lists none
  // `written` are the splats as they are read from the file; they are rendered as other programs render
  // Gaussians. Requires that cameras() is not 0.
  ExportLoss measure(const MixedModel& written);

 private:
  std::string device_;
  TrainSettings settings_;
  Split split_{.name = "cameras of the model", .views = {}};
  std::vector<std::vector<float>> own_, black_;
};

}  // namespace ubs::tools
