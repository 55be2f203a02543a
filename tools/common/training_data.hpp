// SPDX-License-Identifier: Apache-2.0
// What a training starts from: the splits of a data folder, checked against the settings, and the first
// splats.
#pragma once

#include "host/data/dataset.hpp"
#include "host/scene/splat_model.hpp"
#include "host/spec/train_settings.hpp"
#include "tools/common/dataset.hpp"

namespace ubs::tools {

// Every view has an image and the query values that N needs.
Split take_train(Dataset& data, const TrainSettings& settings);
// The test split is optional, and so are its images: what cannot be measured is left out.
Split take_test(Dataset& data, const TrainSettings& settings);

// From the points of the data, else inside the stated depth bounds of the cameras, else in a box.
SplatModel initial_model(const Dataset& data, const Split& train, const TrainSettings& settings);

}  // namespace ubs::tools
