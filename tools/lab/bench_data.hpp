// SPDX-License-Identifier: Apache-2.0
// What `ubs-lab bench` measures of the user's own: a model seen by the cameras of a data set of any layout.
#pragma once

#include <string>

#include "host/api/open_data.hpp"
#include "host/lab/bench/bench_case.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs::tools {

// Splats of the model, size of the first view that open_bench_model() will show.
bench::SceneSize bench_model_size(const std::string& model, const std::string& data,
                                  const TrainSettings& settings, const std::optional<OpenedData>& opened);
// The first test views (where there are none, training views), with their images, in the coordinates of the
// model.
bench::BenchScene open_bench_model(const std::string& model, const std::string& data,
                                   const TrainSettings& settings, const std::optional<OpenedData>& opened);

}  // namespace ubs::tools
