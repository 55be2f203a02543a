// SPDX-License-Identifier: Apache-2.0
// Reads SOG versions 2 and 1 and writes version 2; see foreign_formats.hpp. The values are stored in images
// with one pixel per splat, row by row:
// - Positions are transformed by sign(v) ln(|v| + 1), and stored in two bytes per axis, between bounds.
// - Log scales and spherical harmonics of degree 0 are stored as indices into codebooks of 256 numbers.
// - Quaternions are stored as their three smallest components.
// - Spherical harmonics of higher degrees are stored as an index into a palette. The palette is an image
//   with 64 entries per row and one pixel per coefficient of an entry. Its bytes are indices into a third
//   codebook.
// The values of version 1 differ in two ways. Version 1 has lower and upper bounds instead of codebooks, and
// a byte from 0 to 255 is a position between these bounds. And it stores opacities as logits.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numeric>
#include <queue>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/memory_limit.hpp"
#include "host/base/paths.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/webp.hpp"
#include "host/formats/zip.hpp"

namespace ubs {
namespace {

constexpr std::size_t kBook = 256, kPalette = 65536, kPaletteRow = 64;
constexpr std::size_t kSplatBytes = 4 * (3 + 3 + 4 + 1);  // memory of a splat without spherical harmonics
constexpr int kBookRounds = 20;                           // number of rounds of k-means for a codebook
constexpr int kFirstMode = 252;            // alpha of the pixel of a quaternion whose largest component is w
constexpr std::size_t kSplatsAByte = 100;  // maximum plausible number of splats per byte of a file
// An image may have 1.25 times the required number of pixels plus this number. Larger images are not decoded.
constexpr std::size_t kSparePixels = 1 << 20;
constexpr std::size_t kLargestMeta = 1 << 20;  // maximum size of meta.json; its usual size is about 20 KB
// A lossless WebP image has at most about four bytes per pixel. Its header and metadata may have this size.
constexpr std::size_t kImageBytesAPixel = 5, kImageMetadata = 1 << 20;
// Keys of meta.json that are used or known to be irrelevant. A note names all other keys.
constexpr std::string_view kKnownKeys[] = {"version", "asset",  "count", "antialias", "model",
                                           "means",   "scales", "quats", "sh0",       "shN"};

double sog_log(double v) { return std::copysign(std::log1p(std::abs(v)), v); }
double sog_exp(double v) { return std::copysign(std::expm1(std::abs(v)), v); }

// ---- Writing ----

// Returns a codebook: 256 ascending numbers that approximate all values. It starts with 128 quantiles of the
// values and 128 equally spaced numbers. Then each number is moved repeatedly to the mean of the values
// nearest to it (k-means).
std::vector<float> make_book(std::vector<float> values) {
  std::ranges::sort(values);
  std::vector<double> sums(values.size() + 1, 0.0);
  for (std::size_t i = 0; i < values.size(); ++i) sums[i + 1] = sums[i] + values[i];
  std::vector<float> book(kBook, 0.0f);
  if (values.empty()) return book;
  for (std::size_t k = 0; k < kBook / 2; ++k) {
    book[k] = values[(2 * k + 1) * values.size() / kBook];
    const float t = static_cast<float>(k) / (kBook / 2 - 1);
    book[kBook / 2 + k] = std::lerp(values.front(), values.back(), t);
  }
  for (int round = 0; round < kBookRounds; ++round) {
    std::ranges::sort(book);
    std::size_t begin = 0;
    for (std::size_t k = 0; k < kBook; ++k) {
      const float border = k + 1 < kBook ? std::midpoint(book[k], book[k + 1]) : INFINITY;
      const auto end = static_cast<std::size_t>(std::ranges::upper_bound(values, border) - values.begin());
      if (end > begin)
        book[k] = static_cast<float>((sums[end] - sums[begin]) / static_cast<double>(end - begin));
      begin = std::max(begin, end);
    }
  }
  std::ranges::sort(book);
  return book;
}

std::uint8_t entry_of(const std::vector<float>& book, float v) {
  const auto above = std::ranges::lower_bound(book, v);
  if (above == book.begin()) return 0;
  const bool below = above == book.end() || v - above[-1] <= *above - v;
  return static_cast<std::uint8_t>(above - book.begin() - (below ? 1 : 0));
}

// HarmonicCells divides splats into cells with similar spherical harmonics of the higher degrees. While there
// are fewer cells than palette entries, it takes the cell with the largest squared error and splits it at the
// mean of the coefficient with the largest spread.
class HarmonicCells {
 public:
  HarmonicCells(const float* rows, std::size_t stride, std::size_t width, std::size_t count)
      : rows_(rows), stride_(stride), width_(width), order_(count) {
    std::iota(order_.begin(), order_.end(), 0u);
    const auto worse = [](const Cell& a, const Cell& b) { return a.error < b.error; };
    std::priority_queue<Cell, std::vector<Cell>, decltype(worse)> open(worse);
    open.push(cell(0, count));
    while (cells_.size() + open.size() < kPalette && !open.empty() && open.top().error > 0) {
      const Cell c = open.top();
      open.pop();
      const auto first = order_.begin() + static_cast<std::ptrdiff_t>(c.begin);
      const auto last = order_.begin() + static_cast<std::ptrdiff_t>(c.end);
      const auto middle =
          std::partition(first, last, [&](std::uint32_t i) { return at(i, c.widest) < c.mean; });
      if (middle == first || middle == last) {  // the mean was rounded to one of the values
        cells_.push_back(c);
        continue;
      }
      const auto border = static_cast<std::size_t>(middle - order_.begin());
      open.push(cell(c.begin, border)), open.push(cell(border, c.end));
    }
    for (; !open.empty(); open.pop()) cells_.push_back(open.top());
    labels_.resize(count);
    for (std::size_t k = 0; k < cells_.size(); ++k)
      for (std::size_t i = cells_[k].begin; i < cells_[k].end; ++i)
        labels_[order_[i]] = static_cast<std::uint16_t>(k);
  }

  std::size_t size() const { return cells_.size(); }
  std::uint16_t label(std::size_t splat) const { return labels_[splat]; }
  std::vector<float> centre(std::size_t k) const {
    std::vector<float> mean(width_);
    const Cell& c = cells_[k];
    for (std::size_t w = 0; w < width_; ++w) {
      double sum = 0;
      for (std::size_t i = c.begin; i < c.end; ++i) sum += at(order_[i], w);
      mean[w] = static_cast<float>(sum / static_cast<double>(c.end - c.begin));
    }
    return mean;
  }

 private:
  struct Cell {
    std::size_t begin = 0, end = 0, widest = 0;
    double mean = 0, error = 0;
  };
  float at(std::size_t splat, std::size_t w) const { return rows_[splat * stride_ + w]; }
  Cell cell(std::size_t begin, std::size_t end) const {
    Cell c{begin, end};
    double most = -1;
    const auto n = static_cast<double>(end - begin);
    for (std::size_t w = 0; w < width_; ++w) {
      double sum = 0, squares = 0;
      for (std::size_t i = begin; i < end; ++i) sum += at(order_[i], w);
      for (std::size_t i = begin; i < end; ++i) squares += std::pow(at(order_[i], w) - sum / n, 2);
      c.error += squares;
      if (squares > most) most = squares, c.widest = w, c.mean = sum / n;
    }
    return c;
  }

  const float* rows_;
  std::size_t stride_, width_;
  std::vector<std::uint32_t> order_;
  std::vector<Cell> cells_;
  std::vector<std::uint16_t> labels_;
};

std::array<std::uint8_t, 4> sog_rotation(const std::array<float, 4>& q) {
  std::size_t largest = 0;
  for (std::size_t k = 1; k < 4; ++k)
    if (std::abs(q[k]) > std::abs(q[largest])) largest = k;
  std::array<std::uint8_t, 4> out{};
  for (std::size_t k = 0, to = 0; k < 4; ++k) {
    if (k == largest) continue;
    const double v = (q[largest] < 0 ? -q[k] : q[k]) / std::sqrt(2.0) + 0.5;
    out[to++] = static_cast<std::uint8_t>(std::clamp(std::lround(255 * v), 0l, 255l));
  }
  out[3] = static_cast<std::uint8_t>(kFirstMode + static_cast<int>(largest));
  return out;
}

// SplatImage is an image with one pixel per splat, and a few more pixels that fill the last row.
class SplatImage {
 public:
  explicit SplatImage(std::size_t count) {
    const auto side = static_cast<int>(std::ceil(std::sqrt(std::max<double>(1, static_cast<double>(count)))));
    image_ = {side,
              static_cast<int>((std::max<std::size_t>(count, 1) + static_cast<std::size_t>(side) - 1) /
                               static_cast<std::size_t>(side)),
              {}};
    image_.rgba.assign(4 * static_cast<std::size_t>(image_.width) * static_cast<std::size_t>(image_.height),
                       255);
  }
  std::uint8_t* operator[](std::size_t i) { return &image_.rgba[4 * i]; }
  const Rgba8& image() const { return image_; }

 private:
  Rgba8 image_;
};

// ---- Reading ----

// Returns the numbers of an array of meta.json. Throws if the array has fewer than `least` elements, or if
// one of them is not a number. (Exporters write null for infinity and NaN.)
std::vector<double> numbers_of(const Json& array, std::size_t least, const std::string& where) {
  if (!array.is_array() || array.size() < least)
    fail(ErrorKind::data, "{}: expected an array of at least {} numbers", where, least);
  std::vector<double> numbers;
  for (const Json& number : array) {
    if (!number.is_number())
      fail(ErrorKind::data, "{}[{}] is {}: expected a number", where, numbers.size(), number.type_name());
    numbers.push_back(number.get<double>());
  }
  return numbers;
}

// SogFiles is a function that returns the bytes of a file whose name is in meta.json. It throws if the file
// has more than `most_bytes`.
using SogFiles = std::function<std::vector<std::byte>(const std::string& member, std::size_t most_bytes)>;

// SogBook contains the values that the bytes of a channel stand for. `where` names the codebook in messages.
struct SogBook {
  std::vector<float> values;
  std::string where;

  float operator[](std::uint8_t index) const {
    if (index >= values.size())
      fail(ErrorKind::data, "{} has {} entries, but the image refers to entry {} (counted from 0)", where,
           values.size(), index);
    return values[index];
  }
};

struct SogImages {
  const SogFiles& files;
  const Json& meta;
  const std::string& name;

  int version() const { return meta.contains("version") ? meta["version"].get<int>() : 1; }
  std::size_t count() const {
    return (version() == 1 ? meta.at("means").at("shape").at(0) : meta.at("count")).get<std::size_t>();
  }
  Rgba8 get(const char* group, std::size_t file, std::size_t least) const {
    const auto member = meta.at(group).at("files").at(file).get<std::string>();
    const std::size_t most_pixels = least + least / 4 + kSparePixels;
    Rgba8 image = decode_webp(files(member, kImageBytesAPixel * most_pixels + kImageMetadata), most_pixels,
                              fmt::format("{}: {}", name, member));
    if (image.rgba.size() / 4 < least)
      fail(ErrorKind::data, "{}: {}: the image has {} pixels, but {} are needed", name, member,
           image.rgba.size() / 4, least);
    return image;
  }
  std::vector<double> numbers(const char* group, const char* key, std::size_t least) const {
    return numbers_of(meta.at(group).at(key), least, fmt::format("{}: meta.json: {}.{}", name, group, key));
  }
  SogBook book(const char* group, std::size_t channel = 0) const {
    if (version() == 2) {
      const std::vector<double> book = numbers(group, "codebook", 1);
      return {{book.begin(), book.end()}, fmt::format("{}: meta.json: {}.codebook", name, group)};
    }
    std::vector<float> values(kBook);
    // For spherical harmonics of higher degrees (shN), the bounds are single numbers for all channels.
    const auto bound = [&](const char* key) {
      const Json& bounds = meta.at(group).at(key);
      return bounds.is_number() ? bounds.get<double>() : numbers(group, key, channel + 1)[channel];
    };
    const double low = bound("mins"), high = bound("maxs");
    for (std::size_t b = 0; b < kBook; ++b)
      values[b] = static_cast<float>(std::lerp(low, high, static_cast<double>(b) / (kBook - 1)));
    return {std::move(values), {}};
  }
};

// Returns the degree of the spherical harmonics, computed from the width of the palette. It is needed for
// version 1, which does not state the degree.
int degree_of_palette(const Rgba8& palette, const std::string& name) {
  for (int degree = 1; degree <= 3; ++degree)
    if (palette.width == static_cast<int>(kPaletteRow) * ((degree + 1) * (degree + 1) - 1)) return degree;
  fail(ErrorKind::data, "{}: the palette is {} pixels wide, which matches no degree of spherical harmonics",
       name, palette.width);
}

void read_harmonics(const SogImages& images, ImportedSplats& splats) {
  const Json& meta = images.meta.at("shN");
  const std::size_t higher = splats.coefficients() - 1, n = splats.count();
  // Version 1 does not state the number of palette entries.
  const std::size_t promised = images.version() == 1 ? kPaletteRow : meta.at("count").get<std::size_t>();
  if (promised > kPalette)
    fail(ErrorKind::data, "{}: the palette has {} entries, which is more than the format allows", images.name,
         promised);
  const SogBook book = images.book("shN");
  const std::size_t rows = (promised + kPaletteRow - 1) / kPaletteRow;
  const Rgba8 palette = images.get("shN", 0, rows * kPaletteRow * higher), labels = images.get("shN", 1, n);
  const std::size_t entries =
      images.version() == 1 ? static_cast<std::size_t>(palette.height) * kPaletteRow : promised;
  if (static_cast<std::size_t>(palette.width) != kPaletteRow * higher)
    fail(ErrorKind::data, "{}: the palette is {} pixels wide instead of {}", images.name, palette.width,
         kPaletteRow * higher);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t label = labels.rgba[4 * i] | labels.rgba[4 * i + 1] << 8;
    if (label >= entries)
      fail(ErrorKind::data, "{}: splat {} refers to entry {} of a palette with {} entries", images.name, i,
           label, entries);
    for (std::size_t k = 0; k < higher; ++k)
      for (std::size_t c = 0; c < 3; ++c)
        splats.sh[(i * (higher + 1) + k + 1) * 3 + c] = book[palette.rgba[4 * (label * higher + k) + c]];
  }
}

ImportedSplats read_images(const SogImages& images, std::size_t bytes) {
  const Json& meta = images.meta;
  const int version = images.version();
  if (version != 1 && version != 2)
    fail(ErrorKind::data, "{}: SOG version {}: 1 and 2 are supported", images.name, version);
  const std::size_t n = images.count();
  if (n > kSplatsAByte * bytes)
    fail(ErrorKind::data, "{}: {} splats cannot be stored in {} bytes", images.name, n, bytes);
  ImportedSplats splats;
  splats.antialiased = meta.value("antialias", false) || meta.value("model", "") == "antialiased";
  if (meta.contains("shN"))
    splats.sh_degree = version == 1 ? degree_of_palette(images.get("shN", 0, 1), images.name)
                                    : meta["shN"].at("bands").get<int>();
  if (splats.sh_degree < 0 || splats.sh_degree > 3)
    fail(ErrorKind::data, "{}: spherical harmonics of degree {} are not supported", images.name,
         splats.sh_degree);
  const Rgba8 low = images.get("means", 0, n), high = images.get("means", 1, n);
  const Rgba8 scales = images.get("scales", 0, n), quats = images.get("quats", 0, n),
              sh0 = images.get("sh0", 0, n);
  const std::vector<double> least = images.numbers("means", "mins", 3),
                            most = images.numbers("means", "maxs", 3);
  std::array<SogBook, 3> scale_book, colour_book;
  for (std::size_t c = 0; c < 3; ++c)
    scale_book[c] = images.book("scales", c), colour_book[c] = images.book("sh0", c);
  const SogBook logits = version == 1 ? images.book("sh0", 3) : SogBook();
  require_memory(n * (kSplatBytes + 12 * splats.coefficients()),
                 fmt::format("{}: {} splats", images.name, n));
  splats.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint8_t* const q = &quats.rgba[4 * i];
    double rest = 1;
    const int largest = q[3] - kFirstMode;
    for (int k = 0, from = 0; k < 4 && largest >= 0; ++k) {
      if (k == largest) continue;
      const double v = (q[from++] / 255.0 - 0.5) * std::sqrt(2.0);
      splats.rotations[i][static_cast<std::size_t>(k)] = static_cast<float>(v);
      rest -= v * v;
    }
    // If no component is marked as the largest, the rotation is left at 0, and clean() drops the splat.
    if (largest >= 0)
      splats.rotations[i][static_cast<std::size_t>(largest)] =
          static_cast<float>(std::sqrt(std::max(0.0, rest)));
    for (std::size_t c = 0; c < 3; ++c) {
      const int bits = low.rgba[4 * i + c] | high.rgba[4 * i + c] << 8;
      splats.positions[i][c] = static_cast<float>(sog_exp(std::lerp(least[c], most[c], bits / 65535.0)));
      splats.log_scales[i][c] = scale_book[c][scales.rgba[4 * i + c]];
      splats.sh[i * 3 * splats.coefficients() + c] = colour_book[c][sh0.rgba[4 * i + c]];
    }
    const std::uint8_t opacity = sh0.rgba[4 * i + 3];
    splats.opacity_logits[i] = version == 1 ? logits[opacity] : logit_of(opacity / 255.0);
  }
  if (splats.sh_degree > 0) read_harmonics(images, splats);
  return splats;
}

}  // namespace

void write_sog(const std::filesystem::path& path, const ImportedSplats& splats) {
  const std::size_t n = splats.count(), all = splats.coefficients();
  const int degree = std::min(splats.sh_degree, 3);
  const std::size_t higher = static_cast<std::size_t>((degree + 1) * (degree + 1)) - 1;
  require_splats(path, splats);
  std::array<double, 3> low, high;
  low.fill(INFINITY), high.fill(-INFINITY);
  for (const auto& p : splats.positions)
    for (std::size_t k = 0; k < 3; ++k)
      low[k] = std::min(low[k], sog_log(p[k])), high[k] = std::max(high[k], sog_log(p[k]));
  const auto place = [&](std::size_t i, std::size_t k) {
    const double range = high[k] - low[k];
    return range > 0 ? static_cast<unsigned>(
                           std::lround(65535 * (sog_log(splats.positions[i][k]) - low[k]) / range))
                     : 0u;
  };
  // Order the splats along a space-filling curve, so that neighbouring pixels of the images are similar.
  std::vector<std::pair<std::uint64_t, std::size_t>> order(n);
  for (std::size_t i = 0; i < n; ++i)
    order[i] = {spread_bits(place(i, 0)) | spread_bits(place(i, 1)) << 1 | spread_bits(place(i, 2)) << 2, i};
  if (!splats.keep_order) std::ranges::sort(order);

  std::vector<float> values;
  for (const auto& s : splats.log_scales) values.insert(values.end(), s.begin(), s.end());
  const std::vector<float> scale_book = make_book(values);
  values.clear();
  for (std::size_t i = 0; i < n; ++i)
    values.insert(values.end(), &splats.sh[i * 3 * all], &splats.sh[i * 3 * all] + 3);
  const std::vector<float> colour_book = make_book(values);

  SplatImage means_l(n), means_u(n), scales(n), quats(n), sh0(n);
  for (std::size_t to = 0; to < n; ++to) {
    const std::size_t i = order[to].second;
    for (std::size_t k = 0; k < 3; ++k) {
      const unsigned v = place(i, k);
      means_l[to][k] = static_cast<std::uint8_t>(v), means_u[to][k] = static_cast<std::uint8_t>(v >> 8);
      scales[to][k] = entry_of(scale_book, splats.log_scales[i][k]);
      sh0[to][k] = entry_of(colour_book, splats.sh[i * 3 * all + k]);
    }
    std::ranges::copy(sog_rotation(splats.rotations[i]), quats[to]);
    sh0[to][3] = static_cast<std::uint8_t>(std::lround(255 * sigmoid_of(splats.opacity_logits[i])));
  }
  ZipWriter zip;
  Json meta{{"version", 2},
            {"asset", {{"generator", "ubs"}}},
            {"count", n},
            {"antialias", splats.antialiased},
            {"means", {{"mins", low}, {"maxs", high}, {"files", {"means_l.webp", "means_u.webp"}}}},
            {"scales", {{"codebook", scale_book}, {"files", {"scales.webp"}}}},
            {"quats", {{"files", {"quats.webp"}}}},
            {"sh0", {{"codebook", colour_book}, {"files", {"sh0.webp"}}}}};
  std::vector<std::pair<const char*, Rgba8>> images{{"means_l.webp", means_l.image()},
                                                    {"means_u.webp", means_u.image()},
                                                    {"scales.webp", scales.image()},
                                                    {"quats.webp", quats.image()},
                                                    {"sh0.webp", sh0.image()}};
  if (higher > 0) {
    const HarmonicCells cells(splats.sh.data() + 3, 3 * all, 3 * higher, n);
    values.clear();
    for (std::size_t k = 0; k < cells.size(); ++k) {
      const std::vector<float> centre = cells.centre(k);
      values.insert(values.end(), centre.begin(), centre.end());
    }
    const std::vector<float> book = make_book(values);
    const std::size_t rows = (cells.size() + kPaletteRow - 1) / kPaletteRow;
    Rgba8 palette{static_cast<int>(kPaletteRow * higher), static_cast<int>(rows), {}};
    palette.rgba.assign(4 * kPaletteRow * higher * rows, 255);
    for (std::size_t p = 0; p < cells.size() * higher; ++p)
      for (std::size_t c = 0; c < 3; ++c) palette.rgba[4 * p + c] = entry_of(book, values[3 * p + c]);
    SplatImage labels(n);
    for (std::size_t to = 0; to < n; ++to) {
      const std::uint16_t label = cells.label(order[to].second);
      labels[to][0] = static_cast<std::uint8_t>(label), labels[to][1] = static_cast<std::uint8_t>(label >> 8);
      labels[to][2] = 0;
    }
    meta["shN"] = {{"count", cells.size()},
                   {"bands", degree},
                   {"codebook", book},
                   {"files", {"shN_centroids.webp", "shN_labels.webp"}}};
    images.emplace_back("shN_centroids.webp", std::move(palette));
    images.emplace_back("shN_labels.webp", labels.image());
  }
  const std::string text = json_text(meta);
  zip.add("meta.json", std::as_bytes(std::span(text)));
  for (const auto& [name, image] : images) zip.add(name, encode_webp(image));
  write_file_atomically(path, zip.finish());
}

namespace {

ImportedSplats read_meta(const SogFiles& files, const Json& meta, std::size_t bytes,
                         const std::string& name) {
  const SogImages images{files, meta, name};
  ImportedSplats splats;
  try {
    splats = read_images(images, bytes);
    splats.report.layout = fmt::format("SOG version {}", images.version());
    std::vector<std::string> others;
    for (const auto& [key, value] : meta.items())
      if (std::ranges::find(kKnownKeys, key) == std::end(kKnownKeys)) others.push_back(key);
    if (!others.empty())
      splats.report.note(fmt::format("keys of meta.json that are not used: {}", list_names(others)));
  } catch (const nlohmann::json::exception& error) {
    fail(ErrorKind::data, "{}: meta.json does not match the images: {}", name, error.what());
  }
  splats.report.folder = name;
  if (splats.antialiased) splats.report.note("the splats were trained with antialiasing");
  return splats;
}

Json parse_meta(std::span<const std::byte> text, const std::string& name) {
  return parse_json({reinterpret_cast<const char*>(text.data()), text.size()}, name);
}

ImportedSplats read_bundle(std::span<const std::byte> file, const std::string& name) {
  const ZipReader zip(file, name);
  // In some archives, all files are in a folder. `prefix` is the name of this folder with a slash.
  std::vector<std::string> members = zip.names();
  std::string prefix;
  for (const std::string& member : members)
    if (member == "meta.json" || (member.ends_with("/meta.json") && prefix.empty()))
      prefix = member.substr(0, member.size() - std::string_view("meta.json").size());
  const auto get = [&](const std::string& member, std::size_t most_bytes) {
    std::erase(members, prefix + member);
    return zip.get(prefix + member, most_bytes);
  };
  std::erase(members, prefix + "meta.json");
  const std::vector<std::byte> text = zip.get(prefix + "meta.json", kLargestMeta);
  ImportedSplats splats = read_meta(get, parse_meta(text, name), file.size(), name);
  std::erase_if(members, [](const std::string& member) { return member.ends_with('/'); });
  if (!members.empty())
    splats.report.note(
        fmt::format("{} files of the archive are not used (such as {})", members.size(), members.front()));
  return splats;
}

}  // namespace

std::filesystem::path file_beside(const std::filesystem::path& path, const std::string& member) {
  const std::filesystem::path inside(member);
  if (inside.is_absolute() || std::ranges::find(inside, "..") != inside.end())
    fail(ErrorKind::data, "{}: the file '{}' is not in the same folder", path.string(), member.substr(0, 80));
  const std::filesystem::path folder = resolved_path(folder_of(path)), file = folder_of(path) / inside;
  if (std::ranges::mismatch(folder, resolved_path(file)).in1 != folder.end())
    fail(ErrorKind::data, "{}: the file '{}' is a link that leads out of the folder", path.string(),
         member.substr(0, 80));
  return file;
}

ImportedSplats load_sog(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::vector<std::byte> bytes = read_file(path);
  if (bytes.size() < 2 || bytes[0] == std::byte{'P'}) return read_bundle(bytes, name);
  if (bytes.size() > kLargestMeta)
    fail(ErrorKind::data, "{}: {} bytes, but a meta.json of SOG has at most {}", name, bytes.size(),
         kLargestMeta);
  const Json meta = parse_meta(bytes, name);
  std::size_t all = 0;
  for (const std::filesystem::path& entry : folder_entries(folder_of(path)))
    if (is_regular(entry)) all += std::filesystem::file_size(entry);
  const auto get = [&](const std::string& member, std::size_t most_bytes) {
    const std::filesystem::path file = file_beside(path, member);
    if (const auto size = is_regular(file) ? std::filesystem::file_size(file) : 0; size > most_bytes)
      fail(ErrorKind::data, "{}: {} bytes are too many: at most {} are expected", file.string(), size,
           most_bytes);
    return read_file(file);
  };
  return read_meta(get, meta, all, name);
}

ImportedSplats parse_sog(std::span<const std::byte> file, const std::string& name) {
  ImportedSplats splats = read_bundle(file, name);
  clean(splats);
  return splats;
}

ImportedSplats read_sog(const std::filesystem::path& path) {
  ImportedSplats splats = load_sog(path);
  clean(splats);
  return splats;
}

}  // namespace ubs
