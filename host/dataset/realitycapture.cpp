// SPDX-License-Identifier: Apache-2.0
// load_realitycapture() loads the cameras that RealityCapture and RealityScan export: a CSV file with
// "Internal/ External camera parameters", or an XMP file for each image. Focal lengths are those of a film of
// 36 mm, which is the larger of width and height; the principal point is relative to the centre, in units of
// this size.
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <pugixml.hpp>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/stated_views.hpp"
#include "host/formats/other_programs.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

// Intrinsics as the files state them. The lens formula is that of OpenCV with a further radial coefficient,
// and with t1 and t2 in the places of p2 and p1.
struct Intrinsics {
  double f = 0, px = 0, py = 0;
  std::array<double, 4> k{};
  std::array<double, 2> t{};

  Lens lens(ImageSize size) const {
    const double larger = std::max(size.width, size.height), focal = f / 36 * larger;
    Lens lens = make_lens("BROWN", size, focal, focal, size.width / 2.0 + px * larger,
                          size.height / 2.0 + py * larger);
    for (std::size_t i = 0; i < k.size(); ++i) lens.set(fmt::format("k{}", i + 1), k[i]);
    lens.set("p1", t[1]), lens.set("p2", t[0]);
    return lens;
  }
};

// ---- CSV ----

// Returns the cells of a line, without the mark that Windows writes at the start of a file in UTF-8.
std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  constexpr std::string_view kMark = "\xef\xbb\xbf";
  std::istringstream stream(line.starts_with(kMark) ? line.substr(kMark.size()) : line);
  for (std::string cell; std::getline(stream, cell, ',');) {
    while (!cell.empty() && (cell.back() == '\r' || cell.back() == ' ')) cell.pop_back();
    while (!cell.empty() && cell.front() == ' ') cell.erase(0, 1);
    cells.push_back(cell);
  }
  return cells;
}

// Returns whether the line names the columns. Older versions write a line with the number of cameras before
// it.
bool is_head(const std::string& line) {
  const std::vector<std::string> cells = cells_of(line);
  return !cells.empty() && cells[0] == "#name" && std::ranges::count(cells, "heading") == 1 &&
         std::ranges::count(cells, "f") == 1;
}

bool is_csv(const fs::path& file) {
  std::istringstream stream(start_of_file(file));
  std::string line;
  for (int i = 0; i < 3 && std::getline(stream, line); ++i)
    if (is_head(line)) return true;
  return false;
}

// The camera looks down with the top of its image to the north if all angles are 0. It is then rotated by
// `roll` about y, by `pitch` about x, and by `heading` about -z. x points to the east and y to the north.
std::array<double, 9> rotation_of(double heading, double pitch, double roll) {
  constexpr double kDegree = std::numbers::pi / 180;
  const double sz = std::sin(-heading * kDegree), cz = std::cos(-heading * kDegree);
  const double sx = std::sin(pitch * kDegree), cx = std::cos(pitch * kDegree);
  const double sy = std::sin(roll * kDegree), cy = std::cos(roll * kDegree);
  return {cz * cy - sz * sx * sy,
          -sz * cx,
          cz * sy + sz * sx * cy,
          sz * cy + cz * sx * sy,
          cz * cx,
          sz * sy - cz * sx * cy,
          -cx * sy,
          sx,
          cx * cy};
}

std::vector<StatedView> read_csv(const fs::path& file) {
  const std::string text = read_text_file(file);
  if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff"))
    fail(ErrorKind::data, "{}: the text is in UTF-16: save it as UTF-8", file.string());
  std::istringstream stream(text);
  std::vector<StatedView> views;
  std::map<std::string, std::size_t> columns;
  std::size_t number = 0;
  for (std::string line; std::getline(stream, line);) {
    ++number;
    if (is_head(line)) {
      const std::vector<std::string> names = cells_of(line);
      for (std::size_t i = 0; i < names.size(); ++i) columns[names[i]] = i;
      for (const char* name : {"x", "y", "alt", "pitch", "roll"})
        if (!columns.contains(name))
          fail(ErrorKind::data,
               "{}:{}: the column '{}' is missing: export 'Internal/External camera parameters'",
               file.string(), number, name);
      continue;
    }
    const std::vector<std::string> cells = cells_of(line);
    if (cells.empty() || cells[0].empty() || cells[0][0] == '#') continue;
    const std::string where = fmt::format("{}:{}", file.string(), number);
    if (columns.empty()) fail(ErrorKind::data, "{}: there are no names of columns before this line", where);
    if (cells.size() != columns.size())
      fail(ErrorKind::data, "{}: expected {} values, found {}", where, columns.size(), cells.size());
    const auto value = [&](const std::string& column) {
      const auto at = columns.find(column);
      return at == columns.end() ? 0.0 : number_in(cells[at->second], fmt::format("{}: {}", where, column));
    };
    const Intrinsics of{value("f"),
                        value("px"),
                        value("py"),
                        {value("k1"), value("k2"), value("k3"), value("k4")},
                        {value("t1"), value("t2")}};
    views.push_back(
        {{cells[0], where},
         pose_from_world(rotation_of(value("heading"), value("pitch"), value("roll")),
                         {value("x"), value("y"), value("alt")}, CameraAxes::y_up_z_backward, where),
         std::nullopt,
         [of](ImageSize size) { return of.lens(size); }});
  }
  return views;
}

// ---- XMP ----

bool is_xmp(const fs::path& file) { return start_of_file(file).find("xcr:Rotation") != std::string::npos; }

pugi::xml_node find_description(const pugi::xml_node& document) {
  return document.find_node([](const pugi::xml_node& node) {
    return node.child("xcr:Rotation") || node.attribute("xcr:Rotation");
  });
}

// Reads the camera, or reports why it cannot be used. In the XMP files, the rotation is world-to-camera with
// z forward, and the position is that of the camera.
void read_xmp(const fs::path& file, std::vector<StatedView>& views, LoadReport& report) {
  const std::string text = read_text_file(file);
  pugi::xml_document document;
  if (const auto result = document.load_buffer(text.data(), text.size()); !result)
    fail(ErrorKind::data, "{}: malformed XML at byte {}: {}", file.string(), result.offset,
         result.description());
  const std::string where = file.string(), name = file.stem().string();
  const pugi::xml_node node = find_description(document);
  const auto value = [&](const char* key) -> std::string {
    const std::string full = fmt::format("xcr:{}", key);
    const std::string inner = node.child(full.c_str()).text().get();
    return inner.empty() ? node.attribute(full.c_str()).as_string() : inner;
  };
  const auto number = [&](const char* key, double otherwise) {
    const std::string stated = value(key);
    return stated.empty() ? otherwise : number_in(stated, fmt::format("{}: {}", where, key));
  };
  if (!node || value("Position").empty()) return report.skip(name, "its XMP file has no pose");
  const std::string model = value("DistortionModel");
  if (model == "division")
    return report.skip(name,
                       "the lens model 'division' of its XMP file is not supported: export the model Brown");
  if (number("Skew", 0) != 0 || number("AspectRatio", 1) != 1)
    return report.skip(name, "its XMP file has a skew or an aspect ratio of pixels, which is not supported");
  Intrinsics of{
      number("FocalLength35mm", 0), number("PrincipalPointU", 0), number("PrincipalPointV", 0), {}, {}};
  const std::string stated = value("DistortionCoeficients");
  if (!stated.empty() && model != "perspective") {
    // The model brown3 may have only its three radial coefficients.
    const std::string key = where + ": DistortionCoeficients";
    const std::size_t count = words_of(stated).size() == 3 ? 3 : 6;
    const std::vector<double> d = numbers_in(stated, count, key);
    for (std::size_t i = 0; i < d.size(); ++i) (i < 4 ? of.k[i] : of.t[i - 4]) = d[i];
  }
  const std::vector<double> r = numbers_in(value("Rotation"), 9, where + ": Rotation");
  const std::vector<double> c = numbers_in(value("Position"), 3, where + ": Position");
  std::array<double, 9> rotation{};
  std::ranges::copy(r, rotation.begin());
  std::array<double, 3> translation{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) translation[i] -= r[3 * i + k] * c[k];
  views.push_back({{name, where},
                   pose_from_camera(rotation, translation, CameraAxes::y_down_z_forward, where),
                   std::nullopt,
                   [of](ImageSize size) { return of.lens(size); }});
}

// Returns the folder with XMP files of cameras: the folder of the images or the data folder.
fs::path xmp_folder(const fs::path& folder) {
  for (const fs::path& place : {folder, folder / "images"})
    if (const std::vector<fs::path> files = matching_paths(place, "*.xmp");
        std::ranges::any_of(files, is_xmp))
      return place;
  return {};
}

}  // namespace

std::vector<std::string> realitycapture_files(const fs::path& path) {
  if (is_regular(path))
    return small_extension(path) == ".csv" && is_csv(path) ? std::vector{path.string()}
                                                           : std::vector<std::string>{};
  for (const fs::path& file : matching_paths(path, "*.csv"))
    if (is_csv(file)) return {file.filename().string()};
  if (const fs::path folder = xmp_folder(path); !folder.empty())
    return {(folder == path ? fs::path("*.xmp") : folder.filename() / "*.xmp").string()};
  return {};
}

LoadedScene load_realitycapture(const fs::path& path, const DatasetOptions& options) {
  LoadedScene scene;
  DataRoot root(path, options.read.allow_outside);
  const fs::path folder = is_folder(path) ? path : path.parent_path();
  std::vector<fs::path> tables = is_folder(path) ? matching_paths(folder, "*.csv") : std::vector{path};
  std::erase_if(tables, [](const fs::path& file) { return !is_csv(file); });
  std::vector<StatedView> stated;
  std::vector<std::string> places{"images", "."};
  if (!tables.empty()) {
    stated = read_csv(root.check(tables.front()));
    if (tables.size() > 1)
      scene.report.note_difference(
          fmt::format("{} files with cameras of RealityScan: {} is used; to use another "
                      "one, pass the file",
                      tables.size(), tables.front().filename().string()));
  } else {
    const fs::path place = xmp_folder(folder);
    if (place.empty())
      fail(ErrorKind::data, "{}: contains no cameras of RealityScan (*.csv, *.xmp)", path.string());
    for (const fs::path& file : matching_paths(place, "*.xmp"))
      read_xmp(root.check(file), stated, scene.report);
    if (place == folder) places = {"."};
  }
  if (stated.empty())
    fail(ErrorKind::data, "{}: no camera can be used{}", path.string(),
         scene.report.skipped.empty() ? "" : ": " + scene.report.skipped.front().why);
  const ImageFolder images = find_image_folder(folder, options, root, stated[0].image.name, places);
  add_stated_views(scene, folder, images, stated, root, options);
  return scene;
}

}  // namespace ubs
