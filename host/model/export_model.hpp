// SPDX-License-Identifier: Apache-2.0
// exported_splats() converts ubs models to the splats of third-party formats.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "host/formats/reduce_splats.hpp"
#include "host/formats/splat_file.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

// Returns the splats of a model as a third-party format stores them. Formats with Beta splats can only store
// models of N = 3, and store them exactly; for other models the function throws Error(usage). Formats with
// Gaussians can store models of N = 3, and models of N > 3 whose variant Slicer supports; for other models
// the function throws Error(usage), too. Each group is converted separately, and groups that already consist
// of Gaussians are stored exactly. The function appends remarks for the user about the conversion to
// `remarks`. `offset` is added to the positions of the model to get those in the world.
ImportedSplats exported_splats(const SplatFormat& format, const MixedModel& model,
                               const std::array<double, 3>& offset, const ReduceOptions& options,
                               std::vector<std::string>& remarks);

}  // namespace ubs
