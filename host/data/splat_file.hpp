// SPDX-License-Identifier: Apache-2.0
// Loads model files of any known format, recognised by content. ubs files and published files are loaded
// unchanged; third-party files become models of the variant that they were trained with (gaussian_model.hpp).
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

// The parts of a file by which the formats are recognised.
struct FileStart {
  std::string bytes;                      // the first sixteen bytes
  std::string extension;                  // in lower case, with the dot
  std::vector<std::string> ply = {};      // header lines of a PLY file, with one blank between words
  std::vector<std::string> members = {};  // names of the files in a ZIP archive; empty if it is damaged
  std::string packed = {};                // first unpacked bytes of a gzip file; empty if it is damaged
  std::string json = {};                  // the text of a JSON file
};

// A format of model files: a row of the table in splat_file.cpp. A new format needs a reader and a writer, a
// row, and a section in docs/data.md.
struct SplatFormat {
  enum class Holds { ours, beta, gaussians };

  std::string_view name;       // name in --to and in the library: "spz"
  std::string_view title;      // name in messages: "SPZ"
  std::string_view extension;  // usual extension; files with other extensions are recognised too
  Holds holds;
  bool (*recognise)(const FileStart& start);
  ImportedSplats (*read)(const std::filesystem::path& path);  // null: a ubs format
  // Null: a ubs format, or a format that is only read.
  void (*write)(const std::filesystem::path& path, const ImportedSplats& splats);
  bool keeps_offset = false;
  bool keeps_antialiasing = false;  // stores whether splats were trained with it
  bool rounds = false;              // write() stores fewer bits than float32 or omits parameters
  int degree = 3;                   // highest degree of the spherical harmonics that write() stores
  std::vector<std::string> (*remarks)(const ImportedSplats& splats) = nullptr;  // what else write() loses
  std::string_view second_extension = {};  // extension of files that the same function writes
  // For formats that store several time samples of a dynamic model in one file. Null: a file has only one.
  void (*write_series)(const std::filesystem::path& path, const SplatSeries& series) = nullptr;
  // Reads the time sample nearest to `time`, which is from 0 (first sample) to 1 (last sample).
  ImportedSplats (*read_at)(const std::filesystem::path& path, double time) = nullptr;
  // Throws Error(usage) if a program that write() needs is missing. Null: it needs none.
  void (*require_writer)() = nullptr;

  bool ours() const { return holds == Holds::ours; }
};

std::span<const SplatFormat> splat_formats();
// Returns the titles of all formats for messages and help texts, separated by commas.
std::string splat_format_titles();
// Returns whether the file name has the extension of one of the formats. This does not include .json, because
// data sets have such files too.
bool has_splat_extension(const std::filesystem::path& path);
// Returns the names of the formats that can be written; that of ubs comes first.
std::vector<std::string> written_formats();
// Throws Error(usage) if no format that can be written has this name.
const SplatFormat& splat_format(std::string_view name);
// Returns the format to write a file of this extension with (.ply: that of ubs), or null if there is none.
const SplatFormat* format_of_extension(const std::filesystem::path& path);
// Throws Error(data) if the file holds no splats; the message says what it is, for example a point cloud or a
// ZIP archive.
const SplatFormat& detect_splat_format(const std::filesystem::path& path);
// Returns a description of a file: one of the formats, or a known kind of file that holds no splats. Empty if
// the kind is not known.
std::string describe_file(const std::filesystem::path& path);
// Returns the model file that a path refers to: the file itself or, for a folder, its model.ply (output of
// ubs), its meta.json or lod-meta.json (SOG), or the last point_cloud/iteration_*/point_cloud.ply (output of
// 3DGS). Returns an empty path if there is no model, for example for a data folder or a JSON file of data.
std::filesystem::path find_splat_model(const std::filesystem::path& path);

// Reads all formats except those of ubs. If a time is given, reads the time sample nearest to it
// (SplatFormat::read_at); throws Error(usage) if the format has no time samples.
ImportedSplats read_foreign_splats(const std::filesystem::path& path, std::optional<double> time = {});
// Writes the file. Warns if the splats have an offset that the format cannot store.
void write_foreign_splats(const SplatFormat& format, const std::filesystem::path& path,
                          const ImportedSplats& splats);
// Returns sentences about what the format cannot store.
std::vector<std::string> format_remarks(const SplatFormat& format, const ImportedSplats& splats);
inline constexpr const char* kLobesLost =
    "the spherical Beta lobes are lost: the format has no place for them";

struct LoadedModel {
  MixedModel model;                       // only ubs files have several groups
  const SplatFormat* format = nullptr;    // of the file; null: not read from a file
  std::vector<std::string> comments;      // comments that a ubs file with this model has
  std::array<double, 3> offset{0, 0, 0};  // world = model + offset
  ModelNotes notes;                       // from a ubs file; of a third-party file only the up direction
  std::vector<std::string> remarks;       // what was dropped, not used or noticed while reading
};

// Loads a model from a file, or from a folder that contains one. All commands use this function. `time` has
// the same meaning as in read_foreign_splats().
LoadedModel load_splat_model(const std::filesystem::path& given, std::optional<double> time = {});

// Returns sentences for messages: what was dropped while reading, and other remarks.
std::vector<std::string> read_remarks(const ImportedSplats& splats);

}  // namespace ubs
