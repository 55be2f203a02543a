// SPDX-License-Identifier: Apache-2.0
// Models of ours in the files of other tools.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "host/data/reduce_splats.hpp"
#include "host/data/splat_file.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

// The splats of a model as a format of other tools holds them. A format of Beta splats takes those of N = 3
// as they are, and Error(usage) for another model; one of Gaussians takes all models, group by group, and
// those that are Gaussians already as they are. The remarks say what was done.
ImportedSplats exported_splats(const SplatFormat& format, const MixedModel& model,
                               const std::array<double, 3>& offset, const ReduceOptions& options,
                               std::vector<std::string>& remarks);

}  // namespace ubs
