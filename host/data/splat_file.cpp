// SPDX-License-Identifier: Apache-2.0
#include "host/data/splat_file.hpp"

#include <fmt/ranges.h>

#include <algorithm>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/warning.hpp"
#include "host/data/foreign_formats.hpp"
#include "host/data/gaussian_model.hpp"
#include "host/data/ply.hpp"
#include "host/data/ply_header.hpp"
#include "host/data/ubsz.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Holds = SplatFormat::Holds;

bool is_ubsz(const FileStart& start) {
  return start.bytes == std::string_view(kUbszMagic, sizeof kUbszMagic);
}

bool has_property(const FileStart& start, std::string_view name) {
  return std::ranges::any_of(start.ply, [&](const std::string& line) { return line.ends_with(name); });
}
bool has_line(const FileStart& start, std::string_view begin) {
  return std::ranges::any_of(start.ply, [&](const std::string& line) { return line.starts_with(begin); });
}

std::vector<std::string> splat32_remarks(const ImportedSplats& splats) {
  if (splats.sh_degree == 0) return {};
  return {
      fmt::format("harmonics of degree 1 to {} are lost: .splat has one colour a splat", splats.sh_degree)};
}

// In the order in which they are tried: a form of ours may share names with other formats, and a file of
// Gaussians with extra columns may be packed or hold Beta splats.
constexpr SplatFormat kFormats[] = {
    {.name = "ubs",
     .title = "UBS",
     .extension = ".ply",
     .holds = Holds::ours,
     .recognise = [](const FileStart& s) { return is_ubsz(s) || has_line(s, "comment ubs "); },
     .keeps_offset = true,
     .keeps_antialiasing = true},
    {.name = "compressed",
     .title = "SuperSplat compressed PLY",
     .extension = ".ply",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return has_line(s, "element chunk "); },
     .read = read_compressed_ply},
    {.name = "dbs",
     .title = "DBS PLY",
     .extension = ".ply",
     .holds = Holds::beta,
     .recognise = [](const FileStart& s) { return has_property(s, " sh0_0"); },
     .read = read_gaussian_ply,
     .write = write_gaussian_ply,
     .keeps_offset = true},
    {.name = "3dgs",
     .title = "3DGS PLY",
     .extension = ".ply",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return has_property(s, " f_dc_0"); },
     .read = read_gaussian_ply,
     .write = write_gaussian_ply,
     .keeps_offset = true},
    {.name = "spz",
     .title = "SPZ",
     .extension = ".spz",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return s.bytes == "NGSP" || s.bytes.starts_with("\x1f\x8b"); },
     .read = read_spz,
     .write = write_spz,
     .keeps_antialiasing = true,
     .remarks = spz_remarks},
    {.name = "sog",
     .title = "SOG",
     .extension = ".sog",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return s.bytes == "PK\3\4"; },
     .read = read_sog,
     .write = write_sog,
     .keeps_antialiasing = true},
    {.name = "glb",
     .title = "glTF",
     .extension = ".glb",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return s.bytes == "glTF"; },
     .read = read_glb,
     .write = write_glb,
     .keeps_offset = true},
    {.name = "splat",
     .title = ".splat",
     .extension = ".splat",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return !s.bytes.empty() && s.extension == ".splat"; },
     .read = read_splat32,
     .write = write_splat32,
     .remarks = splat32_remarks},
};

bool written(const SplatFormat& format) { return format.ours() || format.write; }

FileStart start_of(const fs::path& path) {
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  FileStart start{std::string(std::min<std::size_t>(size, 4), '\0'), small_extension(path)};
  stream.read(start.bytes.data(), static_cast<std::streamsize>(start.bytes.size()));
  if (!start.bytes.starts_with("ply")) return start;
  // Only the names matter here; whoever reads the file checks the rest.
  constexpr std::size_t kMostLines = 10000;
  for (std::string line;
       start.ply.size() < kMostLines && std::getline(stream, line) && !line.starts_with("end_header");) {
    if (line.ends_with('\r')) line.pop_back();
    start.ply.push_back(line);
  }
  return start;
}

}  // namespace

std::span<const SplatFormat> splat_formats() { return kFormats; }

std::vector<std::string> written_formats() {
  std::vector<std::string> names;
  for (const SplatFormat& format : kFormats)
    if (written(format)) names.emplace_back(format.name);
  return names;
}

const SplatFormat& splat_format(std::string_view name) {
  for (const SplatFormat& format : kFormats)
    if (written(format) && format.name == name) return format;
  fail(ErrorKind::usage, "there is no format '{}' to write: {}", name, fmt::join(written_formats(), ", "));
}

const SplatFormat* format_of_extension(const fs::path& path) {
  const auto found = std::ranges::find_if(kFormats, [&](const SplatFormat& format) {
    return written(format) && format.extension == small_extension(path);
  });
  return found == std::end(kFormats) ? nullptr : &*found;
}

const SplatFormat& detect_splat_format(const fs::path& path) {
  const FileStart start = start_of(path);
  for (const SplatFormat& format : kFormats)
    if (format.recognise(start)) return format;
  if (start.bytes.starts_with("ply")) return kFormats[0];  // its reader says what is missing
  if (start.extension == ".ply") fail(ErrorKind::data, "{}: not a PLY file", path.string());
  std::vector<std::string_view> titles;
  for (const SplatFormat& format : kFormats) titles.push_back(format.title);
  fail(ErrorKind::data, "{}: not a splat file: expected {}", path.string(), fmt::join(titles, ", "));
}

ImportedSplats read_foreign_splats(const fs::path& path) {
  const SplatFormat& format = detect_splat_format(path);
  if (format.ours()) fail(ErrorKind::internal, "{}: a file of ours needs no import", path.string());
  return format.read(path);
}

void write_foreign_splats(const SplatFormat& format, const fs::path& path, const ImportedSplats& splats) {
  if (!format.keeps_offset && splats.offset != std::array<double, 3>{})
    warn("{}: the offset {} is lost: this format has no place for it", path.string(),
         fmt::join(splats.offset, " "));
  format.write(path, splats);
}

std::vector<std::string> format_remarks(const SplatFormat& format, const ImportedSplats& splats) {
  std::vector<std::string> remarks = format.remarks ? format.remarks(splats) : std::vector<std::string>{};
  if (format.holds == Holds::gaussians && splats.lobes > 0) remarks.push_back(kLobesLost);
  if (!format.keeps_antialiasing && splats.antialiased)
    remarks.push_back(
        "draw it with antialiasing: the format cannot say that the splats were trained with it");
  return remarks;
}

std::vector<std::string> read_remarks(const ImportedSplats& splats) {
  std::vector<std::string> remarks;
  for (const auto& s : splats.report.skipped)
    remarks.push_back(
        fmt::format("{} dropped: {} (such as {})", s.count, s.why, fmt::join(s.examples, ", ")));
  for (const std::string& note : splats.report.notes) remarks.push_back(note);
  return remarks;
}

LoadedModel load_splat_model(const fs::path& path) {
  LoadedModel loaded;
  loaded.format = &detect_splat_format(path);
  if (loaded.format->ours()) {
    loaded.model =
        is_ubsz(start_of(path)) ? read_ubsz(path, &loaded.comments) : read_mixed_ply(path, &loaded.comments);
    loaded.offset = offset_comment(loaded.comments, path.string());
    loaded.notes = notes_of(loaded.comments, path.string());
    return loaded;
  }
  const ImportedSplats splats = loaded.format->read(path);
  loaded.offset = splats.offset;
  if (splats.offset != std::array<double, 3>{}) loaded.comments = {make_offset_comment(splats.offset)};
  loaded.model = exact_model(splats);
  loaded.remarks = read_remarks(splats);
  return loaded;
}

}  // namespace ubs
