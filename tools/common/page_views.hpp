// SPDX-License-Identifier: Apache-2.0
// The cameras that pages about a model offer to their readers: those of ubs web, ubs view and
// ubs train --serve.
#pragma once

#include <optional>
#include <string>

#include "host/api/open_data.hpp"
#include "host/look/serve/live.hpp"
#include "tools/common/model_options.hpp"

namespace ubs::tools {

// Returns the views of the data that `options` name, else the cameras that the model names, else some around
// it. `opened`: the data, where they were opened before.
Split page_views(const ModelOptions& options, const LoadedModel& loaded, const TrainSettings& settings,
                 const std::optional<OpenedData>& opened, const FrameHints& hints);

// Returns what the server's page begins with. `path`, of the model or the run, gives the title.
serve::Scene served_scene(const std::string& path, const MixedModel& model, const Split& views,
                          const FrameHints& hints = {});

}  // namespace ubs::tools
