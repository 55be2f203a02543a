// SPDX-License-Identifier: Apache-2.0
// Prepares the input of training: the training and test splits, checked against the settings, and the initial
// model.
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

// Moves the training split out of `data`. Every view has an image and the query values that N dimensions
// need. Aligns the cameras of a static scene if they will be refined.
// Fills in the settings `dim`, `unit`, `background` and `random_background` if they are automatic, and adds
// the choices to the report of the data.
// `begins`: training starts with a new model. Then the function adds points that the images of a static scene
// show, notes if cap_max reduces the number of points, and, if there are no points, says where the initial
// splats are. Otherwise a model exists already, and no points are added.
Split take_train(Dataset& data, TrainSettings& settings, bool begins = true);
// Does the same for a split that is not moved. Reads everything in `data` except the splits.
void settle_training(const Split& train, Dataset& data, TrainSettings& settings, bool begins = true);
// Converts all lengths of the data and of the splits to the unit of training. From then on settings must be
// converted too, with in_unit(settings).
void divide_by_unit(Dataset& data, std::span<Split* const> splits, double unit);
// Returns the number of splats that training starts with if the data have no points, not limited by cap_max.
int random_points(const Split& train, const TrainSettings& settings);
// Determines properties of the training images. Decodes some of them.
PictureFacts picture_facts(const Split& train, const TrainSettings& settings);
// Returns the approximate number of splats that training starts with. If the scene is unknown, some of the
// random splats are removed later.
std::size_t first_splats(const Dataset& data, const Split& train, const TrainSettings& settings);
// Moves the test split out. It is optional, and so are its images: views without an image are removed,
// because they cannot be measured.
Split take_test(Dataset& data, const TrainSettings& settings);
// Returns the information in the header of a model besides the splats. `cameras`: those of the training
// views, in the unit of the data.
ModelNotes notes_for(const TrainSettings& settings, std::span<const Camera> cameras);
// Returns the same information as comment lines, with the offset of the data if it is not zero.
std::vector<std::string> model_comments(const Dataset& data, const TrainSettings& settings,
                                        std::span<const Camera> cameras);

// Makes the initial model, with at most cap_max splats. Places them, in this order of preference: at the
// points of the data; inside of the depth bounds that the data state; in the box of init_extent; in the space
// that the cameras look at (host/api/camera_rig.hpp).
SplatModel initial_model(const Dataset& data, const Split& train, const TrainSettings& settings);

}  // namespace ubs
