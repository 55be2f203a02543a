// SPDX-License-Identifier: Apache-2.0
// See splat_file.hpp.
#include "host/formats/splat_file.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <sstream>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/base/warning.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/gaussian_model.hpp"
#include "host/formats/other_programs.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/ply_header.hpp"
#include "host/formats/ubsz.hpp"
#include "host/formats/zip.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Holds = SplatFormat::Holds;

bool is_ubsz(const FileStart& start) {
  return start.bytes.starts_with(std::string_view(kUbszMagic, sizeof kUbszMagic));
}
bool is_zip(const FileStart& start) { return start.bytes.starts_with("PK\3\4"); }
bool is_gzip(const FileStart& start) { return start.bytes.starts_with("\x1f\x8b"); }
bool is_ply(const FileStart& start) { return start.bytes.starts_with("ply"); }

// Returns whether the text of a JSON file contains the key. The text is not parsed: if the JSON is damaged,
// the reader of the format reports the error.
bool has_key(const FileStart& start, std::string_view key) {
  return start.json.find(fmt::format("\"{}\"", key)) != std::string::npos;
}
bool has_member(const FileStart& start, std::string_view end) {
  return std::ranges::any_of(start.members, [&](const std::string& name) { return name.ends_with(end); });
}
// The files of gsplat's PNG compression have the same keys except "files".
bool is_sog_meta(const FileStart& start) {
  return has_key(start, "means") && has_key(start, "quats") && has_key(start, "files");
}
bool is_lod_meta(const FileStart& start) { return has_key(start, "filenames") && has_key(start, "tree"); }

bool has_property(const FileStart& start, std::string_view name) {
  return std::ranges::any_of(start.ply, [&](const std::string& line) { return line.ends_with(name); });
}
bool has_line(const FileStart& start, std::string_view begin) {
  return std::ranges::any_of(start.ply, [&](const std::string& line) { return line.starts_with(begin); });
}

std::vector<std::string> splat32_remarks(const ImportedSplats& splats) {
  if (splats.sh_degree == 0) return {};
  return {
      fmt::format("spherical harmonics of degree 1 to {} are lost: a .splat file stores one colour per splat",
                  splats.sh_degree)};
}

// The formats, in the order in which they are tried. The order matters: files of ubs may have property names
// of other formats, and a file that looks like Gaussians with extra columns may be a compressed file or
// contain Beta splats.
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
     .keeps_offset = true,
     .keeps_antialiasing = true},
    {.name = "3dgs",
     .title = "3DGS PLY",
     .extension = ".ply",
     .holds = Holds::gaussians,
     .recognise =
         [](const FileStart& s) {
           return has_property(s, " f_dc_0") || (has_property(s, " red") && has_property(s, " scale_0") &&
                                                 has_property(s, " rot_0") && !has_property(s, " beta_0"));
         },
     .read = read_gaussian_ply,
     .write = write_gaussian_ply,
     .keeps_offset = true,
     .keeps_antialiasing = true},
    {.name = "spz",
     .title = "SPZ",
     .extension = ".spz",
     .holds = Holds::gaussians,
     .recognise =
         [](const FileStart& s) {
           return s.bytes.starts_with("NGSP") ||
                  (is_gzip(s) && (s.packed.empty() || s.packed.starts_with("NGSP")));
         },
     .read = read_spz,
     .write = write_spz,
     .keeps_antialiasing = true,
     .rounds = true,
     .remarks = spz_remarks},
    {.name = "sog",
     .title = "SOG",
     .extension = ".sog",
     .holds = Holds::gaussians,
     .recognise =
         [](const FileStart& s) {
           return is_sog_meta(s) ||
                  (is_zip(s) && !has_member(s, "lod-meta.json") &&
                   (s.members.empty() ? s.extension != ".zip" : has_member(s, "meta.json")));
         },
     .read = read_sog,
     .write = write_sog,
     .keeps_antialiasing = true,
     .rounds = true},
    {.name = "streamed-sog",
     .title = "streamed SOG",
     .extension = ".json",
     .holds = Holds::gaussians,
     .recognise = is_lod_meta,
     .read = read_streamed_sog},
    {.name = "glb",
     .title = "glTF",
     .extension = ".glb",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return s.bytes.starts_with("glTF"); },
     .read = read_gltf,
     .write = write_glb,
     .keeps_offset = true},
    {.name = "gltf",
     .title = "glTF text",
     .extension = ".gltf",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return !s.bytes.empty() && s.extension == ".gltf"; },
     .read = read_gltf},
    {.name = "usda",
     .title = "USD text",
     .extension = ".usda",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return s.bytes.starts_with("#usda"); },
     .read = read_usda,
     .write = write_usda,
     .keeps_offset = true,
     .remarks = usd_remarks,
     .write_series = write_usda_series,
     .read_at = read_usda_at},
    {.name = "usdc",
     .title = "binary USD",
     .extension = ".usdc",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return s.bytes.starts_with("PXR-USDC"); },
     .read = read_usdc,
     .write = write_usdc,
     .keeps_offset = true,
     .remarks = usd_remarks,
     .second_extension = ".usd",
     .write_series = write_usdc_series,
     .read_at = read_usdc_at,
     .require_writer = require_usd_converter},
    {.name = "splat",
     .title = ".splat",
     .extension = ".splat",
     .holds = Holds::gaussians,
     .recognise = [](const FileStart& s) { return !s.bytes.empty() && s.extension == ".splat"; },
     .read = read_splat32,
     .write = write_splat32,
     .rounds = true,
     .degree = 0,
     .remarks = splat32_remarks},
};

// ---- Files that hold no splats, and how messages describe them ----

// OtherFile describes a kind of files without splats. what() returns the description of a file for messages.
struct OtherFile {
  bool (*recognise)(const FileStart& start);
  std::string (*what)(const FileStart& start);
};

// Returns the number of rows of an element, as stated in the header.
std::string rows_of(const FileStart& start, std::string_view element) {
  const std::string begin = fmt::format("element {} ", element);
  for (const std::string& line : start.ply)
    if (line.starts_with(begin)) return line.substr(begin.size());
  return "0";
}

// Returns the number of vertices. Some programs call the element "point".
std::string points_of(const FileStart& start) {
  return rows_of(start, has_line(start, "element point ") ? "point" : "vertex");
}

std::string what_zip(const FileStart& start) {
  if (start.members.empty()) return "a ZIP archive: unpack it first";
  std::string example = start.members.front();
  for (const std::string& member : start.members)
    if (!member.ends_with('/')) example = member;
  return fmt::format("a ZIP archive of {} files, such as '{}': unpack it first", start.members.size(),
                     example.substr(0, 80));
}

std::string what_gzip(const FileStart& start) {
  const std::string_view inside = start.packed.starts_with("ply") ? "a PLY file"
                                  : start.packed.find("ustar") != std::string::npos
                                      ? "an archive (tar)"
                                      : "a file that is not SPZ";
  return fmt::format("{} compressed with gzip: unpack it first", inside);
}

// Kinds of files that contain no splats. They are tried if no format was recognised. Files of Scaffold-GS
// would be recognised as splats, because their anchors have properties with the same names, so format_of()
// excludes these files first.
constexpr OtherFile kOthers[] = {
    {[](const FileStart& s) { return s.bytes.empty(); },
     [](const FileStart&) -> std::string { return "an empty file"; }},
    {[](const FileStart& s) { return has_property(s, " f_anchor_feat_0"); },
     [](const FileStart& s) {
       return fmt::format(
           "{} anchors of Scaffold-GS, no splats: its networks generate the splats for each view",
           rows_of(s, "vertex"));
     }},
    {[](const FileStart& s) {
       return is_ply(s) && !has_property(s, " scale_0") && rows_of(s, "face") != "0" && has_property(s, " x");
     },
     [](const FileStart& s) {
       return fmt::format("a mesh with {} vertices and {} faces, but no splats", rows_of(s, "vertex"),
                          rows_of(s, "face"));
     }},
    {[](const FileStart& s) { return is_ply(s) && !has_property(s, " scale_0") && has_property(s, " x"); },
     [](const FileStart& s) {
       return fmt::format(
           "a point cloud of {} points, no splats: point clouds can only be used in a data folder, as "
           "initial points for training",
           points_of(s));
     }},
    {[](const FileStart& s) {
       return has_property(s, " scale_0") && has_property(s, " rot_0") && !has_property(s, " beta_0") &&
              !has_property(s, " red");
     },
     [](const FileStart&) -> std::string {
       return "splats without colours: property 'f_dc_0' (spherical harmonics) or 'red' (type uchar) is "
              "required";
     }},
    {[](const FileStart& s) { return is_zip(s) && has_member(s, "data.pkl"); },
     [](const FileStart&) -> std::string {
       return "a PyTorch checkpoint: export the splats as PLY with the program that wrote it";
     }},
    {[](const FileStart& s) {
       return s.bytes.starts_with("\x93NUMPY") || (is_zip(s) && has_member(s, ".npy"));
     },
     [](const FileStart&) -> std::string {
       return "arrays of NumPy: export the splats as PLY with the program that wrote it";
     }},
    {is_zip, what_zip},
    {is_gzip, what_gzip},
    {[](const FileStart& s) {
       return s.bytes.starts_with("7z\xbc\xaf") || s.bytes.starts_with("Rar!") || s.extension == ".tar";
     },
     [](const FileStart&) -> std::string { return "an archive: unpack it first"; }},
    {[](const FileStart& s) { return has_key(s, "frames"); },
     [](const FileStart&) -> std::string { return "cameras of a data folder, no splats"; }},
    {[](const FileStart& s) { return has_key(s, "asset") && has_key(s, "meshes"); },
     [](const FileStart&) -> std::string { return "glTF as text: its name must end with .gltf"; }},
    {[](const FileStart& s) { return !s.json.empty(); },
     [](const FileStart&) -> std::string { return "a JSON file, no splats"; }},
    {[](const FileStart& s) {
       return s.bytes.starts_with("LASF") || s.bytes.starts_with("ASTM-E57") || s.bytes.starts_with("# .PCD");
     },
     [](const FileStart&) -> std::string { return "a point cloud, no splats"; }},
    {[](const FileStart& s) { return s.bytes.starts_with("\x80\x02") || s.extension == ".pth"; },
     [](const FileStart&) -> std::string {
       return "a Python pickle, such as a PyTorch checkpoint: export the splats as PLY with the program that "
              "wrote it";
     }},
    {[](const FileStart& s) {
       return s.bytes.starts_with("<!DOCTYPE") || s.bytes.starts_with("<!doctype") ||
              s.bytes.starts_with("<html");
     },
     [](const FileStart&) -> std::string { return "a web page: download the file itself"; }},
    {[](const FileStart& s) { return s.bytes.starts_with("\x89PNG") || s.bytes.starts_with("\xff\xd8\xff"); },
     [](const FileStart&) -> std::string { return "an image without splats"; }},
};

bool written(const SplatFormat& format) { return format.ours() || format.write; }

// Stores the start of the unpacked data in `start`, which is used to recognise the file. If the file is
// damaged, nothing is stored, and the reader of the file reports the error.
void look_into_gzip(std::ifstream& stream, std::size_t size, FileStart& start, const std::string& name) {
  constexpr std::size_t kPacked = 1 << 16, kUnpacked = 512;
  std::vector<std::byte> packed(std::min(size, kPacked));
  stream.seekg(0);
  stream.read(reinterpret_cast<char*>(packed.data()), static_cast<std::streamsize>(packed.size()));
  try {
    const std::vector<std::byte> plain = inflate_gzip_start(packed, kUnpacked, name);
    start.packed.assign(reinterpret_cast<const char*>(plain.data()), plain.size());
  } catch (const Error&) {
  }
}

void look_into_ply(std::ifstream& stream, FileStart& start) {
  constexpr std::size_t kMostLines = 10000;
  stream.seekg(0);
  for (std::string line; start.ply.size() < kMostLines && std::getline(stream, line);) {
    std::istringstream words(line);
    std::string& plain = start.ply.emplace_back();
    for (std::string word; words >> word;) plain += (plain.empty() ? "" : " ") + word;
    if (plain.starts_with("end_header")) return;
  }
}

FileStart start_of(const fs::path& path) {
  constexpr std::size_t kLargestJson = std::size_t{64} << 20;  // larger JSON files do not describe splats
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  FileStart start{std::string(std::min<std::size_t>(size, 16), '\0'), small_extension(path)};
  stream.read(start.bytes.data(), static_cast<std::streamsize>(start.bytes.size()));
  const std::size_t text = start.bytes.find_first_not_of(" \t\r\n");
  if (is_ply(start)) look_into_ply(stream, start);
  if (is_gzip(start)) look_into_gzip(stream, size, start, path.string());
  if (is_zip(start)) start.members = zip_member_names(path);
  if (start.extension == ".json" && text != std::string::npos &&
      (start.bytes[text] == '{' || start.bytes[text] == '[') && size <= kLargestJson)
    start.json = read_text_file(path);
  return start;
}

const SplatFormat* format_of(const FileStart& start) {
  if (has_property(start, " f_anchor_feat_0")) return nullptr;
  const auto found = std::ranges::find_if(kFormats, [&](const SplatFormat& f) { return f.recognise(start); });
  return found == std::end(kFormats) ? nullptr : &*found;
}

std::string what_other(const fs::path& path, const FileStart& start) {
  using Content = OtherProgram::Content;
  for (const Content content : {Content::splats, Content::cameras})
    if (std::string what = describe_other_program(path, content); !what.empty()) return what;
  for (const OtherFile& other : kOthers)
    if (other.recognise(start)) return other.what(start);
  return {};
}

ImportedSplats read_as(const SplatFormat& format, const fs::path& path, std::optional<double> time) {
  if (time && !format.read_at)
    fail(ErrorKind::usage, "{}: a {} file has no time samples to choose from", path.string(), format.title);
  ImportedSplats splats = time ? format.read_at(path, *time) : format.read(path);
  std::size_t dropped = 0;
  for (const LoadReport::Skipped& skipped : splats.report.skipped) dropped += skipped.count;
  if (splats.count() == 0 && dropped == 0) fail(ErrorKind::data, "{}: the file has no splats", path.string());
  if (splats.count() == 0)
    fail(ErrorKind::data, "{}: none of its {} splats can be rendered: {}", path.string(), dropped,
         splats.report.skipped.front().why);
  // The offset of a PLY file is a comment of ubs. Those of other files are translations.
  if (format.extension != ".ply") apply_offset(splats);
  return splats;
}

}  // namespace

std::span<const SplatFormat> splat_formats() { return kFormats; }

std::string splat_format_titles() {
  std::vector<std::string_view> titles;
  for (const SplatFormat& format : kFormats) titles.push_back(format.title);
  return fmt::format("{}", fmt::join(titles, ", "));
}

bool has_splat_extension(const fs::path& path) {
  const std::string extension = small_extension(path);
  return !extension.empty() && extension != ".json" &&
         std::ranges::any_of(kFormats, [&](const SplatFormat& format) {
           return format.extension == extension || format.second_extension == extension;
         });
}

std::vector<std::string> written_formats() {
  std::vector<std::string> names;
  for (const SplatFormat& format : kFormats)
    if (written(format)) names.emplace_back(format.name);
  return names;
}

const SplatFormat& splat_format(std::string_view name) {
  for (const SplatFormat& format : kFormats)
    if (written(format) && format.name == name) return format;
  fail(ErrorKind::usage, "unknown output format '{}': choose one of {}", name,
       fmt::join(written_formats(), ", "));
}

const SplatFormat* format_of_extension(const fs::path& path) {
  const auto found = std::ranges::find_if(kFormats, [&](const SplatFormat& format) {
    const std::string extension = small_extension(path);
    return written(format) && !extension.empty() &&
           (format.extension == extension || format.second_extension == extension);
  });
  return found == std::end(kFormats) ? nullptr : &*found;
}

void check_splat_name(const fs::path& path) {
  // Ends of names of splat files and archives, and what they state.
  constexpr std::pair<std::string_view, std::string_view> kNotWritten[] = {
      {".compressed.ply", "SuperSplat compressed PLY"},
      {".gltf", "glTF text"},
      {".usdz", "a USD archive"},
      {".ksplat", "GaussianSplats3D"},
      {".splatv", "splats with motion"},
      {".splat4d", "splats with motion"},
      {".4dgs", "splats with motion"},
      {".lcc", "XGRIDS LCC"},
      {".rad", "Spark RAD"},
      {".spx", "SPX"},
      {".gz", "compression"},
      {".zst", "compression"},
      {".xz", "compression"},
      {".bz2", "compression"},
      {".br", "compression"},
      {".zip", "an archive"},
      {".tar", "an archive"},
      {".tgz", "an archive"},
      {".7z", "an archive"},
      {".pt", "a PyTorch file"},
      {".pth", "a PyTorch file"},
      {".ckpt", "a PyTorch file"},
      {".npz", "arrays of NumPy"},
      {".npy", "arrays of NumPy"},
      {".json", "JSON"}};
  std::string name = path.filename().string();
  std::ranges::transform(name, name.begin(),
                         [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  for (const auto& [end, what] : kNotWritten)
    if (name.ends_with(end))
      fail(ErrorKind::usage, "{}: the name ends with {} ({}), which cannot be written: choose another name",
           path.string(), end, what);
}

const SplatFormat& detect_splat_format(const fs::path& path) {
  const FileStart start = start_of(path);
  if (const SplatFormat* format = format_of(start)) return *format;
  if (const std::string what = what_other(path, start); !what.empty())
    fail(ErrorKind::data, "{}: {}", path.string(), what);
  if (is_ply(start)) return kFormats[0];  // the reader of ubs files reports which properties are missing
  if (start.extension == ".ply") fail(ErrorKind::data, "{}: not a PLY file", path.string());
  fail(ErrorKind::data, "{}: not a splat file: expected {}", path.string(), splat_format_titles());
}

std::string describe_file(const fs::path& path) {
  const FileStart start = start_of(path);
  if (const SplatFormat* format = format_of(start)) return fmt::format("a splat model ({})", format->title);
  return what_other(path, start);
}

std::string describe_splat_folder(const fs::path& folder) {
  if (std::string what = describe_other_program(folder, OtherProgram::Content::splats); !what.empty())
    return what;
  std::vector<std::string> models;
  for (const fs::path& file : folder_entries(folder))
    if (has_splat_extension(file) && is_regular(file))
      if (const FileStart start = start_of(file);
          format_of(start) || (is_ply(start) && what_other(file, start).empty()))
        models.push_back(file.filename().string());
  if (models.empty()) return {};
  const std::string example = shell_word((folder / models.back()).string());
  if (models.size() == 1) return fmt::format("a folder with one splat file: pass the file: {}", example);
  return fmt::format(
      "a folder with {} splat files ({} to {}), each of which is a model of its own, such as one moment of a "
      "sequence: pass one of them, such as {}",
      models.size(), models.front(), models.back(), example);
}

fs::path find_splat_model(const fs::path& path) {
  const auto has_splats = [](const fs::path& file) {
    if (!is_regular(file)) return false;
    const FileStart start = start_of(file);
    return is_sog_meta(start) || is_lod_meta(start);
  };
  if (!is_folder(path)) return small_extension(path) != ".json" || has_splats(path) ? path : fs::path();
  if (path_exists(path / "model.ply")) return path / "model.ply";
  for (const char* name : {"meta.json", "lod-meta.json"})
    if (has_splats(path / name)) return path / name;
  const std::vector<fs::path> models = trainer_output(path).models;
  return models.empty() ? fs::path() : models.back();
}

ImportedSplats read_foreign_splats(const fs::path& path, std::optional<double> time) {
  const SplatFormat& format = detect_splat_format(path);
  if (format.ours())
    fail(ErrorKind::internal, "{}: this is a ubs model, which needs no import", path.string());
  return read_as(format, path, time);
}

void require_splats(const fs::path& path, const ImportedSplats& splats) {
  if (splats.count() == 0) fail(ErrorKind::data, "{}: there are no splats to write", path.string());
}

void write_foreign_splats(const SplatFormat& format, const fs::path& path, const ImportedSplats& splats) {
  if (!format.keeps_offset && splats.offset != std::array<double, 3>{})
    warn("{}: the offset {} is lost, because this format cannot store it", path.string(),
         fmt::join(splats.offset, " "));
  format.write(path, splats);
}

std::vector<std::string> format_remarks(const SplatFormat& format, const ImportedSplats& splats) {
  std::vector<std::string> remarks = format.remarks ? format.remarks(splats) : std::vector<std::string>{};
  if (format.holds == Holds::gaussians && splats.lobes > 0) remarks.push_back(kLobesLost);
  if (!format.keeps_antialiasing && splats.antialiased)
    remarks.push_back(
        "render it with antialiasing: the splats were trained with it, but the format cannot store this");
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

LoadedModel load_splat_model(const fs::path& given, std::optional<double> time) {
  const fs::path path = is_folder(given) ? find_splat_model(given) : given;
  if (path.empty()) {
    const std::string what = describe_splat_folder(given);
    fail(ErrorKind::data, "{}: {}", given.string(), what.empty() ? "no model.ply in this folder" : what);
  }
  LoadedModel loaded;
  loaded.format = &detect_splat_format(path);
  if (loaded.format->ours()) {
    if (time) fail(ErrorKind::usage, "{}: this file has no time samples to choose from", path.string());
    loaded.model = is_ubsz(start_of(path)) ? read_ubsz(path, &loaded.comments)
                                           : read_mixed_ply(path, &loaded.comments, &loaded.remarks);
    if (loaded.model.count() == 0) fail(ErrorKind::data, "{}: the file has no splats", path.string());
    loaded.offset = offset_comment(loaded.comments, path.string());
    loaded.notes = notes_of(loaded.comments, path.string());
    return loaded;
  }
  const ImportedSplats splats = read_as(*loaded.format, path, time);
  loaded.offset = splats.offset;
  loaded.notes.up = Vec3{0, -1, 0};  // as in the axes of cameras, y points down
  loaded.comments = comments_of(loaded.notes);
  if (splats.offset != std::array<double, 3>{}) loaded.comments.push_back(make_offset_comment(splats.offset));
  loaded.model = exact_model(splats);
  loaded.remarks = read_remarks(splats);
  return loaded;
}

}  // namespace ubs
