// SPDX-License-Identifier: Apache-2.0
// Models of ours in the files of other tools.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "host/data/imported_splats.hpp"
#include "host/data/reduce_splats.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

// For dbs Beta splats of N = 3 as they are; Error(usage) for another model. For the formats of Gaussians
// group by group, those that are Gaussians already as they are. The remarks say what was done.
ImportedSplats foreign_splats(const std::string& format, const MixedModel& model,
                              const std::array<double, 3>& offset, const ReduceOptions& options,
                              std::vector<std::string>& remarks);

// `format`: 3dgs, dbs, spz, sog, glb or splat; throws Error(usage) for another. Warns of an offset that the
// format has no place for.
void write_foreign(const std::string& format, const std::filesystem::path& path,
                   const ImportedSplats& splats);
// What the format has no place for.
std::vector<std::string> format_remarks(const std::string& format, const ImportedSplats& splats);

}  // namespace ubs
