// SPDX-License-Identifier: Apache-2.0
// page_views() returns the cameras that can be selected in the pages of `ubs web` and `ubs view`.
// served_scene() returns the initial state of the pages of `ubs view` and `ubs train --serve`.
#pragma once

#include <optional>
#include <string>

#include "host/look/serve/live.hpp"
#include "host/run/open_data.hpp"
#include "tools/common/model_options.hpp"

namespace ubs::tools {

// Returns the views of the data that `options` name. If they name no data, returns the cameras that the model
// lists. If the model lists none, returns some cameras around the model. `opened` contains the data if they
// have been opened already.
Split page_views(const ModelOptions& options, const LoadedModel& loaded, const TrainSettings& settings,
                 const std::optional<OpenedData>& opened, const FrameHints& hints);

// Returns whether the views of page_views() are those of the data or of the model.
bool are_captured(const ModelOptions& options, const LoadedModel& loaded);

// Returns the initial state of the server's page. The title is made from `path`, the path of the model or
// run. `captured` states whether photographs of the scene were taken from the views.
serve::Scene served_scene(const std::string& path, const MixedModel& model, const Split& views, bool captured,
                          const FrameHints& hints = {});

}  // namespace ubs::tools
