// SPDX-License-Identifier: Apache-2.0
// Model files of any known format, recognised by content: our own and the published one as they are,
// files of other tools in the form that they were trained with (gaussian_model.hpp).
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/data/imported_splats.hpp"
#include "host/data/model_notes.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

class SplatSeries;

// What tells the formats apart.
struct FileStart {
  std::string bytes;                      // the first sixteen
  std::string extension;                  // in small letters, with the point
  std::vector<std::string> ply = {};      // lines of the header of a PLY file, one blank between words
  std::vector<std::string> members = {};  // names of the files in a ZIP archive; none where it is damaged
  std::string packed = {};                // first bytes of what gzip has packed; none where it is damaged
  std::string json = {};                  // the text of a JSON file
};

// A format of model files: a row of the table in splat_file.cpp. A new one needs its reader and writer, a
// row, and a section of docs/data.md.
struct SplatFormat {
  enum class Holds { ours, beta, gaussians };

  std::string_view name;       // of --to and of the library: "spz"
  std::string_view title;      // for messages: "SPZ"
  std::string_view extension;  // of its files; they are recognised under other names too
  Holds holds;
  bool (*recognise)(const FileStart& start);
  ImportedSplats (*read)(const std::filesystem::path& path);                       // null: ours
  void (*write)(const std::filesystem::path& path, const ImportedSplats& splats);  // null: ours, or only read
  bool keeps_offset = false;
  bool keeps_antialiasing = false;  // says whether splats were trained with it
  std::vector<std::string> (*remarks)(const ImportedSplats& splats) = nullptr;  // what write() loses besides
  std::string_view second_extension = {};  // of files that are written in the same way
  // For formats that store several moments of a model that moves in one file; null: a file has one moment.
  void (*write_series)(const std::filesystem::path& path, const SplatSeries& series) = nullptr;
  // Reads the moment nearest to `time`, from 0, the first moment, to 1, the last one.
  ImportedSplats (*read_at)(const std::filesystem::path& path, double time) = nullptr;
  // Throws Error(usage) if a program that writing needs is missing; null: it needs none.
  void (*require_writer)() = nullptr;

  bool ours() const { return holds == Holds::ours; }
};

std::span<const SplatFormat> splat_formats();
// The names of those that can be written, ours first.
std::vector<std::string> written_formats();
// Throws Error(usage) where none of the written formats has the name.
const SplatFormat& splat_format(std::string_view name);
// The written format whose files have this extension, of .ply ours; null: there is none.
const SplatFormat* format_of_extension(const std::filesystem::path& path);
// Throws Error(data) that says what the file is where it holds no splats: a point cloud, a ZIP archive.
const SplatFormat& detect_splat_format(const std::filesystem::path& path);
// Returns what a file is, in words: one of the formats, or a known kind of file that holds no splats. Empty
// where it is not known.
std::string describe_file(const std::filesystem::path& path);
// Returns the model that a path names: a file itself; of a folder its model.ply (a run of ours), meta.json or
// lod-meta.json (SOG), or the last point_cloud/iteration_*/point_cloud.ply (a run of 3DGS). Empty: no model,
// such as a folder or a JSON file of data.
std::filesystem::path find_splat_model(const std::filesystem::path& path);

// Every format but our own. With a time, the moment nearest to it (SplatFormat::read_at); Error(usage) if the
// format has no moments.
ImportedSplats read_foreign_splats(const std::filesystem::path& path, std::optional<double> time = {});
// Warns of an offset that the format has no place for.
void write_foreign_splats(const SplatFormat& format, const std::filesystem::path& path,
                          const ImportedSplats& splats);
// What the format has no place for.
std::vector<std::string> format_remarks(const SplatFormat& format, const ImportedSplats& splats);
inline constexpr const char* kLobesLost =
    "the spherical Beta lobes are lost: the format has no place for them";

struct LoadedModel {
  MixedModel model;                       // several groups in files of ours only
  const SplatFormat* format = nullptr;    // of the file; null: it is from none
  std::vector<std::string> comments;      // that a file of ours with this model has
  std::array<double, 3> offset{0, 0, 0};  // world = model + offset
  ModelNotes notes;                       // of a file of ours
  std::vector<std::string> remarks;       // what reading dropped, did not use and noticed
};

// The one way from a file, or a folder with one, to a model. `time` as in read_foreign_splats().
LoadedModel load_splat_model(const std::filesystem::path& given, std::optional<double> time = {});

// What reading the file dropped, and other remarks, for messages.
std::vector<std::string> read_remarks(const ImportedSplats& splats);

}  // namespace ubs
