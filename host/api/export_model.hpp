// SPDX-License-Identifier: Apache-2.0
// Converts ubs models to the splats of third-party formats.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "host/data/reduce_splats.hpp"
#include "host/data/splat_file.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

// Returns the splats of a model as a third-party format stores them. A format with Beta splats stores models
// of N = 3 exactly; other models throw Error(usage). A format with Gaussians stores all models, group by
// group; groups that are Gaussians already are stored exactly. `remarks` receives sentences that say what was
// done.
ImportedSplats exported_splats(const SplatFormat& format, const MixedModel& model,
                               const std::array<double, 3>& offset, const ReduceOptions& options,
                               std::vector<std::string>& remarks);

}  // namespace ubs
