// SPDX-License-Identifier: Apache-2.0
// These functions prepare the input of a training run. They check the training and test splits against the
// settings, choose the automatic settings, and make the initial model.
#pragma once

#include <span>

#include "host/api/open_data.hpp"
#include "host/data/load_dataset.hpp"
#include "host/data/model_notes.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/scene/splat_model.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/fast_settings.hpp"

namespace ubs {

// Moves the training split out of `data` and returns it. Throws an error unless every view has an image and
// the query values that N dimensions need. If the settings request refined cameras and the scene is static,
// first corrects the camera poses (align_cameras.hpp). Chooses the settings `dim`, `unit`, `background` and
// `random_background` if they are automatic, and adds notes about the choices to the report of the data.
// `begins` says whether training starts with a new model. If so, the function adds points that it
// triangulates from the images of a static scene. It also adds a note if cap_max reduces the number of
// points, or, if there are no points, a note about the positions of the initial splats. If `begins` is false,
// a model exists already, and no points are added.
Split take_train(Dataset& data, TrainSettings& settings, bool begins = true);
// Does the same as take_train() for a split that has already been moved out or copied, but does not align
// cameras. Does not use the splits in `data`.
void settle_training(const Split& train, Dataset& data, TrainSettings& settings, bool begins = true);
// Converts all lengths of the data and of the splits to the unit of training. The settings that are used with
// the converted data must be converted too, with in_unit(settings).
void divide_by_unit(Dataset& data, std::span<Split* const> splits, double unit);
// Returns the number of splats that training starts with if the data have no points. The limit cap_max is not
// applied.
int random_points(const Split& train, const TrainSettings& settings);
// Determines properties of the training images that settings depend on. Decodes some of the images.
PictureFacts picture_facts(const Split& train, const TrainSettings& settings);
// Returns the approximate number of splats that training starts with. If the splats are placed at random, the
// actual number may be smaller, because splats that are too close to a camera are removed.
std::size_t first_splats(const Dataset& data, const Split& train, const TrainSettings& settings);
// Moves the test split out of `data` and returns it. If the data have no test split, logs a warning and
// returns a split without views. Removes views without an image, because their quality cannot be measured.
Split take_test(Dataset& data, const TrainSettings& settings);
// Returns the information that the header of a model file contains in addition to the splats. `cameras` are
// those of the training views, in the unit of the data.
ModelNotes notes_for(const TrainSettings& settings, std::span<const Camera> cameras);
// Returns the same information as comment lines, with the offset of the data if it is not zero.
std::vector<std::string> model_comments(const Dataset& data, const TrainSettings& settings,
                                        std::span<const Camera> cameras);

// Makes the initial model, with at most cap_max splats. The splats are placed at the points of the data, if
// there are any. Otherwise they are placed at random: between the depth bounds, if the data state them;
// otherwise in the box of size init_extent, if this setting is set; otherwise in the space that the cameras
// see (host/api/camera_rig.hpp).
SplatModel initial_model(const Dataset& data, const Split& train, const TrainSettings& settings);

}  // namespace ubs
