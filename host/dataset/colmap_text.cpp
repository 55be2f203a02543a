// SPDX-License-Identifier: Apache-2.0
// This file reads COLMAP's text files. Lines that start with '#' are comments. cameras.txt and points3D.txt
// have one line per camera or point. images.txt has two lines per image: the first describes the image, and
// the second holds its observations and may be empty. Error messages name the file and the line.
#include <algorithm>
#include <charconv>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/colmap.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

class LineReader {
 public:
  explicit LineReader(const fs::path& path) : name_(path.string()), text_(read_text_file(path)) {}

  // Reads the next line that is not a comment; returns false at the end. Skips empty lines unless
  // `keep_empty` is set.
  bool next(bool keep_empty = false) {
    while (at_ < text_.size()) {
      const std::size_t end = std::min(text_.find('\n', at_), text_.size());
      line_ = std::string_view(text_).substr(at_, end - at_);
      at_ = end + 1;
      ++number_;
      if (!line_.empty() && line_.back() == '\r') line_.remove_suffix(1);
      if (line_.starts_with('#')) continue;
      if (!keep_empty && line_.find_first_not_of(" \t") == std::string_view::npos) continue;
      return true;
    }
    line_ = {};
    return false;
  }

  std::string where() const { return fmt::format("{}:{}", name_, number_); }
  bool has_word() const { return line_.find_first_not_of(" \t") != std::string_view::npos; }

  std::string_view word(const char* what) {
    const std::size_t first = line_.find_first_not_of(" \t");
    if (first == std::string_view::npos) fail(ErrorKind::data, "{}: {} is missing", where(), what);
    const std::size_t end = std::min(line_.find_first_of(" \t", first), line_.size());
    const std::string_view found = line_.substr(first, end - first);
    line_.remove_prefix(end);
    return found;
  }

  // Returns the rest of the line without leading and trailing blanks. It is used for file names, which may
  // contain blanks.
  std::string rest(const char* what) {
    const std::size_t first = line_.find_first_not_of(" \t");
    if (first == std::string_view::npos) fail(ErrorKind::data, "{}: {} is missing", where(), what);
    return std::string(line_.substr(first, line_.find_last_not_of(" \t") + 1 - first));
  }

  // Reads a number. A floating-point number must be finite, unless `finite_or_not` is set.
  template <typename T>
  T number(const char* what, bool finite_or_not = false) {
    const std::string_view text = word(what);
    T value{};
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    if (result.ec != std::errc() || result.ptr != text.data() + text.size())
      fail(ErrorKind::data, "{}: {} '{}' is not a number, or is out of range", where(), what,
           text.substr(0, 40));
    if constexpr (std::is_floating_point_v<T>)
      if (!finite_or_not && !std::isfinite(value)) fail(ErrorKind::data, "{}: {} is {}", where(), what, text);
    return value;
  }

  // Returns whether the line is empty or holds observations. Each observation consists of three numbers: x, y
  // and the number of a point. A line that describes an image consists of nine numbers and a file name. It is
  // recognised because one of its first twelve words is not a number. If the file name is a number too, the
  // line is recognised because it has ten words, which is not a multiple of three.
  bool has_observations() const {
    std::size_t words = 0;
    for (std::size_t at = 0; (at = line_.find_first_not_of(" \t", at)) != std::string_view::npos;) {
      const std::size_t end = std::min(line_.find_first_of(" \t", at), line_.size());
      double ignored = 0;
      const auto result = std::from_chars(line_.data() + at, line_.data() + end, ignored);
      // Number of words that are checked. The file name in a line that describes an image starts with the
      // tenth word.
      constexpr std::size_t kLooked = 12;
      if (words < kLooked && (result.ec == std::errc::invalid_argument || result.ptr != line_.data() + end))
        return false;
      ++words, at = end;
    }
    return words % 3 == 0;
  }

 private:
  std::string name_, text_;
  std::string_view line_;
  std::size_t at_ = 0, number_ = 0;
};

}  // namespace

void read_colmap_text_cameras(const fs::path& path, ColmapModel& model) {
  for (LineReader in(path); in.next();) {
    const auto id = in.number<std::uint32_t>("camera number");
    const std::string name(in.word("camera model"));
    const auto width = in.number<std::uint64_t>("width"), height = in.number<std::uint64_t>("height");
    std::vector<double> parameters;
    while (in.has_word()) parameters.push_back(in.number<double>("parameter", true));
    add_colmap_camera(model, id, name, width, height, parameters, in.where());
  }
}

// Reads images.txt. Every image has a second line for observations, which may be empty. If the second line is
// missing, as in many files that were written by hand, the next line describes the next image.
void read_colmap_text_images(const fs::path& path, ColmapModel& model) {
  LineReader in(path);
  for (bool more = in.next(); more;) {
    ColmapImage image;
    in.number<std::uint32_t>("image number");
    for (double& q : image.rotation) q = in.number<double>("quaternion", true);
    for (double& t : image.translation) t = in.number<double>("translation", true);
    image.camera = in.number<std::uint32_t>("camera number");
    image.name = in.rest("file name");
    add_colmap_image(model, std::move(image), in.where());
    more = in.next(true);
    if (more && in.has_observations()) more = in.next();
  }
}

// Reads points3D.txt. Colours are integers from 0 to 255. Files that were written by hand also contain
// colours with decimals, such as 29.0, or colours from 0 to 1.
void read_colmap_text_points(const fs::path& path, ColmapModel& model) {
  std::vector<std::array<double, 3>> colours;
  bool fractions = false;
  double largest = 0;
  for (LineReader in(path); in.next();) {
    in.number<std::uint64_t>("point number");
    std::array<double, 3> position{}, colour{};
    for (double& c : position) c = in.number<double>("coordinate", true);
    for (double& c : colour) {
      c = in.number<double>("colour");
      if (!(c >= 0 && c <= 255)) fail(ErrorKind::data, "{}: colour '{}' is not from 0 to 255", in.where(), c);
      fractions = fractions || c != std::floor(c);
      largest = std::max(largest, c);
    }
    if (in.has_word()) in.number<double>("error", true);
    if (add_point(model.points, position, {}, model.points.positions.size(), in.where()))
      colours.push_back(colour);
  }
  model.scaled_colours = fractions && largest <= 1;
  for (std::size_t i = 0; i < colours.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      model.points.colours[i][k] =
          static_cast<std::uint8_t>(std::lround(model.scaled_colours ? 255 * colours[i][k] : colours[i][k]));
}

std::size_t count_colmap_text_images(const fs::path& model) {
  if (!path_exists(model / "images.txt")) return 0;
  std::size_t count = 0;
  for (LineReader in(model / "images.txt"); in.next();) count += !in.has_observations();
  return count;
}

}  // namespace ubs
