// SPDX-License-Identifier: Apache-2.0
// Model files of any known format, recognised by content: our own and the published one as they are,
// files of other tools in the form that they were trained with (gaussian_model.hpp).
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "host/data/imported_splats.hpp"
#include "host/data/model_notes.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

enum class SplatFormat { ubs, gaussian_ply, dbs, compressed_ply, spz, splat32, glb, sog };

const char* format_name(SplatFormat format);
SplatFormat detect_splat_format(const std::filesystem::path& path);

// Every format but our own.
ImportedSplats read_foreign_splats(const std::filesystem::path& path);

struct LoadedModel {
  MixedModel model;  // several groups in files of ours only
  SplatFormat format = SplatFormat::ubs;
  std::vector<std::string> comments;      // that a file of ours with this model has
  std::array<double, 3> offset{0, 0, 0};  // world = model + offset
  ModelNotes notes;                       // of a file of ours
  std::vector<std::string> remarks;       // what reading a file of another tool dropped and noticed
};

// The one way from a file to a model.
LoadedModel load_splat_model(const std::filesystem::path& path);

// What reading the file dropped, and other remarks, for messages.
std::vector<std::string> read_remarks(const ImportedSplats& splats);

}  // namespace ubs
