// SPDX-License-Identifier: Apache-2.0
// load_splat_model() loads model files of any known format. The format is recognised by the content of the
// file, except that of .splat and .gltf files, which are recognised by the extension. Files of ubs and of the
// published code are loaded unchanged; third-party files are converted to models of the variant that they
// were trained with (gaussian_model.hpp).
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/formats/imported_splats.hpp"
#include "host/formats/model_notes.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs {

class SplatSeries;

// FileStart contains the parts of a file by which the formats are recognised.
struct FileStart {
  std::string bytes;                      // the first sixteen bytes
  std::string extension;                  // in lower case, with the dot
  std::vector<std::string> ply = {};      // header lines of a PLY file, with one blank between words
  std::vector<std::string> members = {};  // names of the files in a ZIP archive; empty if it is damaged
  std::string packed = {};                // first unpacked bytes of a gzip file; empty if it is damaged
  // Text of a file with the extension .json that contains a JSON object or array; empty for other
  // files and for files of more than 64 MiB.
  std::string json = {};
};

// SplatFormat describes a format of model files. The formats are the rows of a table in splat_file.cpp. A new
// format needs a reader and a writer, a row in the table, and a section in docs/data.md.
struct SplatFormat {
  // Kind of splats in the file: models of ubs, Beta splats of DBS, or Gaussians.
  enum class Holds { ours, beta, gaussians };

  std::string_view name;   // name in --to and in the library, such as "spz"
  std::string_view title;  // name in messages, such as "SPZ"
  std::string_view
      extension;  // usual extension; only .splat, .gltf and .json files must have it to be recognised
  Holds holds;
  bool (*recognise)(const FileStart& start);
  ImportedSplats (*read)(const std::filesystem::path& path);  // null for the format of ubs
  // Null for the format of ubs, and for formats that can only be read.
  void (*write)(const std::filesystem::path& path, const ImportedSplats& splats);
  bool keeps_offset = false;        // whether files store ImportedSplats::offset
  bool keeps_antialiasing = false;  // whether files store ImportedSplats::antialiased
  bool rounds = false;              // whether write() stores fewer bits than float32, or omits parameters
  int degree = 3;                   // highest degree of the spherical harmonics that write() stores
  // Returns sentences about other losses of write(). Null if there are none.
  std::vector<std::string> (*remarks)(const ImportedSplats& splats) = nullptr;
  std::string_view second_extension = {};  // another extension of files that write() creates
  // Writes several time samples of a dynamic model to one file. Null if a file can only store one time
  // sample.
  void (*write_series)(const std::filesystem::path& path, const SplatSeries& series) = nullptr;
  // Reads the time sample nearest to `time`, which ranges from 0 (first sample) to 1 (last sample). Null if a
  // file can only store one time sample.
  ImportedSplats (*read_at)(const std::filesystem::path& path, double time) = nullptr;
  // Throws Error(usage) if a program that write() needs is missing. Null if write() needs no program.
  void (*require_writer)() = nullptr;

  bool ours() const { return holds == Holds::ours; }
};

// Returns all formats.
std::span<const SplatFormat> splat_formats();
// Returns the titles of all formats for messages and help texts, separated by commas.
std::string splat_format_titles();
// Returns whether the file name has the extension of one of the formats. This does not include .json, because
// data sets have such files too.
bool has_splat_extension(const std::filesystem::path& path);
// Returns the names of the formats that can be written; the name of the format of ubs comes first.
std::vector<std::string> written_formats();
// Returns the format with this name. Throws Error(usage) if no format that can be written has this name.
const SplatFormat& splat_format(std::string_view name);
// Returns the format in which a file with the extension of `path` is written, or null if there is none. For
// .ply, this is the format of ubs.
const SplatFormat* format_of_extension(const std::filesystem::path& path);
// Throws Error(usage) if the end of the name of an output file states a form of splats, or a compression,
// that no writer creates, such as .compressed.ply, .ply.gz or .usdz.
void check_splat_name(const std::filesystem::path& path);
// Returns the format of a file. If the file contains no splats, throws Error(data) with a message that says
// which kind of file it is, for example a point cloud or a ZIP archive.
const SplatFormat& detect_splat_format(const std::filesystem::path& path);
// Returns the kind of a file in words: a model in one of the formats, or a known kind of file without splats.
// The text is empty if the kind is not known.
std::string describe_file(const std::filesystem::path& path);
// Returns a sentence that says which splats are in a folder without a model (find_splat_model()), and what to
// pass instead. The text is empty if there are none.
std::string describe_splat_folder(const std::filesystem::path& folder);
// Returns the model file that a path refers to: the file itself or, for a folder, its model.ply (output of
// ubs), its meta.json or lod-meta.json (SOG), or the last file of a trainer's output (other_programs.hpp).
// Returns an empty path if there is no model, for example for a data folder or a JSON file of data.
std::filesystem::path find_splat_model(const std::filesystem::path& path);

// Reads a file of any format except that of ubs. If `time` is set, reads the time sample nearest to it
// (SplatFormat::read_at), and throws Error(usage) if the format has no time samples.
ImportedSplats read_foreign_splats(const std::filesystem::path& path, std::optional<double> time = {});
// Writes the file. Warns if the splats have an offset that the format cannot store.
void write_foreign_splats(const SplatFormat& format, const std::filesystem::path& path,
                          const ImportedSplats& splats);
// Returns sentences about properties of the splats that the format cannot store.
std::vector<std::string> format_remarks(const SplatFormat& format, const ImportedSplats& splats);
inline constexpr const char* kLobesLost =
    "the spherical Beta lobes are lost: the format has no place for them";

struct LoadedModel {
  MixedModel model;                       // only ubs files have several groups
  const SplatFormat* format = nullptr;    // format of the file; null if the model was not read from a file
  std::vector<std::string> comments;      // comments that are written if the model is saved as a ubs file
  std::array<double, 3> offset{0, 0, 0};  // world position = position in the model + offset
  ModelNotes notes;                       // for a third-party file, only the up direction is set
  std::vector<std::string> remarks;       // sentences about data that were dropped, not used or unusual
};

// Loads a model from a file, or from a folder that contains one. All commands use this function. `time` has
// the same meaning as in read_foreign_splats().
LoadedModel load_splat_model(const std::filesystem::path& given, std::optional<double> time = {});

// Returns sentences for messages about splats that were dropped while reading, and the notes of the reader.
std::vector<std::string> read_remarks(const ImportedSplats& splats);

}  // namespace ubs
