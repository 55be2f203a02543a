// SPDX-License-Identifier: Apache-2.0
// These functions open a model and a data set of any layout for `ubs-lab bench` and `ubs-lab tune`, which
// measure how fast the model is rendered from the cameras of the data.
#pragma once

#include <string>

#include "host/lab/bench/bench_case.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/run/open_data.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs::tools {

// Returns the number of splats of the model and the size of the first view that open_bench_model() will show.
bench::SceneSize bench_model_size(const std::string& model, const std::string& data,
                                  const TrainSettings& settings, const std::optional<OpenedData>& opened);
// Returns the model with up to 32 test views that have images, or training views if there are no test views.
// The cameras are in the coordinates of the model.
bench::BenchScene open_bench_model(const std::string& model, const std::string& data,
                                   const TrainSettings& settings, const std::optional<OpenedData>& opened);

}  // namespace ubs::tools
