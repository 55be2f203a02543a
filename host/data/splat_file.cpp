// SPDX-License-Identifier: Apache-2.0
// See splat_file.hpp.
#include "host/data/splat_file.hpp"

#include <cstring>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/data/foreign_formats.hpp"
#include "host/data/gaussian_model.hpp"
#include "host/data/ply.hpp"
#include "host/data/ply_header.hpp"
#include "host/data/ubsz.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

bool is_ubsz(const char (&head)[4]) { return std::memcmp(head, kUbszMagic, sizeof head) == 0; }

SplatFormat detect_ply(const fs::path& path) {
  // Only the names matter here; whoever reads the file checks the rest. A chunk in front means packed.
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  std::string line;
  bool chunk = false, gaussian = false, dbs = false, ours = false;
  for (int i = 0; i < 10000 && std::getline(stream, line) && !line.starts_with("end_header"); ++i) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    chunk |= line.starts_with("element chunk ");
    gaussian |= line.ends_with(" f_dc_0");
    dbs |= line.ends_with(" sh0_0");
    ours |= line.starts_with("comment ubs ");  // a variant of ours may share names with other formats
  }
  return ours       ? SplatFormat::ubs
         : chunk    ? SplatFormat::compressed_ply
         : dbs      ? SplatFormat::dbs
         : gaussian ? SplatFormat::gaussian_ply
                    : SplatFormat::ubs;
}

}  // namespace

const char* format_name(SplatFormat format) {
  switch (format) {
    case SplatFormat::ubs:
      return "UBS";
    case SplatFormat::gaussian_ply:
      return "3DGS PLY";
    case SplatFormat::dbs:
      return "DBS PLY";
    case SplatFormat::compressed_ply:
      return "SuperSplat compressed PLY";
    case SplatFormat::spz:
      return "SPZ";
    case SplatFormat::splat32:
      return ".splat";
    case SplatFormat::glb:
      return "glTF";
    case SplatFormat::sog:
      return "SOG";
  }
  return "";
}

SplatFormat detect_splat_format(const fs::path& path) {
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  char head[4] = {};
  stream.read(head, sizeof head);
  if (std::memcmp(head, "ply", 3) == 0) return detect_ply(path);
  if (is_ubsz(head)) return SplatFormat::ubs;
  if (std::memcmp(head, "NGSP", 4) == 0 || std::memcmp(head, "\x1f\x8b", 2) == 0) return SplatFormat::spz;
  if (std::memcmp(head, "glTF", 4) == 0) return SplatFormat::glb;
  if (std::memcmp(head, "PK\3\4", 4) == 0) return SplatFormat::sog;
  if (size > 0 && small_extension(path) == ".splat") return SplatFormat::splat32;
  if (small_extension(path) == ".ply") fail(ErrorKind::data, "{}: not a PLY file", path.string());
  fail(ErrorKind::data,
       "{}: not a splat file: expected PLY (UBS, DBS, 3DGS, SuperSplat), UBSZ, SPZ, SOG, GLB or .splat",
       path.string());
}

ImportedSplats read_foreign_splats(const fs::path& path) {
  switch (detect_splat_format(path)) {
    case SplatFormat::gaussian_ply:
    case SplatFormat::dbs:
      return read_gaussian_ply(path);
    case SplatFormat::compressed_ply:
      return read_compressed_ply(path);
    case SplatFormat::spz:
      return read_spz(path);
    case SplatFormat::splat32:
      return read_splat32(path);
    case SplatFormat::glb:
      return read_glb(path);
    case SplatFormat::sog:
      return read_sog(path);
    case SplatFormat::ubs:
      break;
  }
  fail(ErrorKind::internal, "{}: a file of ours needs no import", path.string());
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
  loaded.format = detect_splat_format(path);
  if (loaded.format == SplatFormat::ubs) {
    std::size_t size = 0;
    char head[4] = {};
    open_for_reading(path, size).read(head, sizeof head);
    loaded.model = is_ubsz(head) ? read_ubsz(path, &loaded.comments) : read_mixed_ply(path, &loaded.comments);
    loaded.offset = offset_comment(loaded.comments, path.string());
    loaded.notes = notes_of(loaded.comments, path.string());
    return loaded;
  }
  const ImportedSplats splats = read_foreign_splats(path);
  loaded.offset = splats.offset;
  if (splats.offset != std::array<double, 3>{}) loaded.comments = {make_offset_comment(splats.offset)};
  loaded.model = exact_model(splats);
  loaded.remarks = read_remarks(splats);
  return loaded;
}

}  // namespace ubs
