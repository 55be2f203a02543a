// SPDX-License-Identifier: Apache-2.0
// Model files of any known format, recognised by content: our own and the published one as they are,
// files of other tools through the importers. What the import changes is told in words.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "host/data/import_splats.hpp"
#include "host/data/imported_splats.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

enum class SplatFormat { ubs, gaussian_ply, dbs, compressed_ply, spz, splat32 };

const char* format_name(SplatFormat format);
SplatFormat detect_splat_format(const std::filesystem::path& path);

// Every format but our own.
ImportedSplats read_foreign_splats(const std::filesystem::path& path);

struct LoadedModel {
  MixedModel model;  // several groups in files of ours only
  SplatFormat format = SplatFormat::ubs;
  std::vector<std::string> comments;      // of a PLY file of ours
  std::array<double, 3> offset{0, 0, 0};  // world = model + offset
  std::vector<std::string> remarks;       // what an import dropped, changed, and advises
  std::optional<double> eps2d;            // advised blur of an import
};

LoadedModel load_splat_model(const std::filesystem::path& path, const ImportOptions& options = {});

// The remarks of an import in words.
std::vector<std::string> import_remarks(const ImportedSplats& splats, const ImportedModel& imported);

}  // namespace ubs
