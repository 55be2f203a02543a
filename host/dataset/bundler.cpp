// SPDX-License-Identifier: Apache-2.0
// load_bundler() loads bundle.out of Bundler, which VisualSFM, Metashape and other programs export, too. Its
// poses are world-to-camera with y up and z backward, and the origin of the image is its centre.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <sstream>
#include <string>
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

bool is_bundle(const fs::path& file) { return start_of_file(file).starts_with("# Bundle file"); }

fs::path find_bundle(const fs::path& path) {
  if (is_regular(path)) return small_extension(path) == ".out" && is_bundle(path) ? path : fs::path();
  for (const char* pattern : {"bundle.out", "bundle/bundle.out", "*.out"})
    for (const fs::path& file : matching_paths(path, pattern))
      if (is_bundle(file)) return file;
  return {};
}

// Returns the file with the names of the images, which is next to bundle.out or in the folder above.
fs::path find_list(const fs::path& file, const fs::path& folder) {
  for (const fs::path& place : {file.parent_path(), folder})
    for (const char* name : {"list.txt", "list.orig.txt", "image_list.txt", "imgs.txt"})
      if (path_exists(place / name)) return place / name;
  if (fs::path same = fs::path(file).replace_extension(".list.txt"); path_exists(same)) return same;
  return {};
}

// BundleReader reads lines of numbers and counts them, for error messages.
class BundleReader {
 public:
  explicit BundleReader(const fs::path& file) : name_(file.string()), stream_(read_text_file(file)) {}

  std::string line() {
    std::string text;
    do {
      if (!std::getline(stream_, text)) fail(ErrorKind::data, "{}: ends after line {}", name_, number_);
      ++number_;
    } while (text.empty() || text[0] == '#' || text == "\r");
    return text;
  }
  std::vector<double> numbers(std::size_t count) { return numbers_in(line(), count, where()); }
  std::string where() const { return fmt::format("{}:{}", name_, number_); }

 private:
  std::string name_;
  std::istringstream stream_;
  std::size_t number_ = 0;
};

// A line is the name of an image, which may be followed by 0 and its focal length.
std::vector<std::string> read_image_list(const fs::path& file) {
  std::istringstream stream(read_text_file(file));
  std::vector<std::string> names;
  for (std::string line; std::getline(stream, line);) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    if (line.empty()) continue;
    std::istringstream words(line);
    std::vector<std::string> parts;
    for (std::string word; words >> word;) parts.push_back(word);
    const bool focal = parts.size() > 2 && parts[parts.size() - 2] == "0";
    names.push_back(focal ? line.substr(0, line.rfind(" 0 ")) : line);
  }
  return names;
}

}  // namespace

std::vector<std::string> bundler_files(const fs::path& path) {
  const fs::path file = find_bundle(path);
  if (file.empty()) return {};
  return {is_regular(path) ? file.string() : file.lexically_relative(path).string()};
}

LoadedScene load_bundler(const fs::path& path, const DatasetOptions& options) {
  LoadedScene scene;
  DataRoot root(path, options.read.allow_outside);
  const fs::path file = find_bundle(path), folder = is_folder(path) ? path : path.parent_path();
  if (file.empty()) fail(ErrorKind::data, "{}: contains no bundle.out of Bundler", path.string());
  const fs::path list = find_list(file, folder);
  if (list.empty())
    fail(ErrorKind::data, "{}: the list of its images is missing: write their names, one per line, to {}",
         file.string(), (file.parent_path() / "list.txt").string());
  const std::vector<std::string> names = read_image_list(root.check(list));
  BundleReader in(root.check(file));
  const std::vector<double> counts = in.numbers(2);
  if (counts[0] != static_cast<double>(names.size()))
    fail(ErrorKind::data, "{}: {} cameras, but {} lists {} images", in.where(), counts[0], list.string(),
         names.size());
  std::vector<StatedView> stated;
  for (const std::string& name : names) {
    const std::vector<double> lens = in.numbers(3);
    const std::string where = in.where();
    std::array<double, 9> rotation{};
    std::array<double, 3> translation{};
    for (std::size_t r = 0; r < 3; ++r)
      std::ranges::copy(in.numbers(3), rotation.begin() + static_cast<int>(3 * r));
    std::ranges::copy(in.numbers(3), translation.begin());
    if (lens[0] == 0) {
      scene.report.skip(name, "Bundler has not registered it");
      continue;
    }
    stated.push_back({{name, where},
                      pose_from_camera(rotation, translation, CameraAxes::y_up_z_backward, where),
                      std::nullopt,
                      [lens](ImageSize size) {
                        Lens result =
                            make_lens("RADIAL", size, lens[0], lens[0], size.width / 2.0, size.height / 2.0);
                        result.set("k1", lens[1]), result.set("k2", lens[2]);
                        return result;
                      }});
  }
  if (stated.empty())
    fail(ErrorKind::data, "{}: none of the {} images is registered", file.string(), names.size());
  if (counts[1] > 0) scene.points.emplace();
  for (double i = 0; i < counts[1]; ++i) {
    const std::vector<double> p = in.numbers(3), rgb = in.numbers(3);
    std::array<std::uint8_t, 3> colour{};
    for (std::size_t k = 0; k < 3; ++k) colour[k] = static_cast<std::uint8_t>(std::clamp(rgb[k], 0.0, 255.0));
    add_point(*scene.points, {p[0], p[1], p[2]}, colour, scene.points->positions.size(), in.where());
    in.line();  // the images that show the point
  }
  const ImageFolder images =
      find_image_folder(folder, options, root, stated[0].image.name, {".", "images", "visualize"});
  add_stated_views(scene, folder, images, stated, root, options);
  return scene;
}

}  // namespace ubs
