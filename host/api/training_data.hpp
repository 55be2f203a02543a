// SPDX-License-Identifier: Apache-2.0
// What training begins with: its two splits, checked against the settings, and its first model.
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

// With an image for every view, and the query values that N dimensions need. Fills in `dim`, `unit`,
// `background` and `random_background` where they are automatic; what was chosen becomes part of the data's
// report. Points of the data beyond cap_max are thinned out evenly. Where there are none,
// so does --init-points auto, and the report says where the first splats lie. Unless training `begins` there
// is a model already, and no points are placed.
Split take_train(Dataset& data, TrainSettings& settings, bool begins = true);
// The same with a split that stays where it is; of `data` all but the splits is looked at.
void settle_training(const Split& train, Dataset& data, TrainSettings& settings, bool begins = true);
// From here on all lengths are in the unit of training: those of the data and of the splits, with
// in_unit(settings).
void divide_by_unit(Dataset& data, std::span<Split* const> splits, double unit);
// How many splats training begins with where the data bring no points, cap_max apart.
int random_points(const Split& train, const TrainSettings& settings);
// Decodes some of them.
PictureFacts picture_facts(const Split& train, const TrainSettings& settings);
// How many it begins with, about: where nothing is known of the scene some random ones are left out.
std::size_t first_splats(const Dataset& data, const Split& train, const TrainSettings& settings);
// The test split is optional, and so are its images: what cannot be measured is left out.
Split take_test(Dataset& data, const TrainSettings& settings);
// What the header of the model says beside the splats. `cameras`: of the training views, in the unit of the
// data.
ModelNotes notes_for(const TrainSettings& settings, std::span<const Camera> cameras);
// The same as comment lines, with the offset of the data where they have one.
std::vector<std::string> model_comments(const Dataset& data, const TrainSettings& settings,
                                        std::span<const Camera> cameras);

// From the points of the data, else inside the stated depth bounds of the cameras, else in the box of
// init_extent, else where the cameras look (host/api/camera_rig.hpp); never more than cap_max splats.
SplatModel initial_model(const Dataset& data, const Split& train, const TrainSettings& settings);

}  // namespace ubs
