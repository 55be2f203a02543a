// SPDX-License-Identifier: Apache-2.0
// facts_of() determines the properties of training data that automatic settings depend on.
#pragma once

#include "host/dataset/load_dataset.hpp"
#include "host/scene/dataset.hpp"
#include "host/settings/facts.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {

// Corrects the camera poses of a static scene with points that are found in the images (align_cameras.hpp).
void align(Dataset& data, Split& train);

// Determines the facts. Decodes some of the images. If the training `begins` with a new model, triangulates
// points from the images of a static scene, and adds them to those of `data`. Adds notes about the points to
// the report of the data. Throws Error(data) if a view has no image, or if the masks exclude all pixels.
Facts facts_of(Dataset& data, const Split& train, const TrainSettings& asked, bool begins = true);

}  // namespace ubs
