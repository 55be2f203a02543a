// SPDX-License-Identifier: Apache-2.0
// See packed.hpp.
#include "host/dataset/packed.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/wide_image_file.hpp"

namespace ubs {
namespace {

static_assert(std::endian::native == std::endian::little, "packed files are little-endian");

constexpr char kPackedMagic[] = "UBSDATA\x1a";
constexpr std::size_t kMagicBytes = 8;
constexpr std::uint32_t kVersionPlain = 1, kVersionMasked = 2, kVersionWide = 3;
constexpr std::size_t kPointBytes = 3 * sizeof(float) + 3;

struct Preamble {
  char magic[kMagicBytes];
  std::uint32_t version, header_crc;
  std::uint64_t header_bytes;
};

std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span(text)); }

std::vector<std::byte> point_bytes(const PointCloud& points) {
  std::vector<std::byte> bytes;
  const auto append = [&](const auto& values) {
    const auto part = std::as_bytes(std::span(values));
    bytes.insert(bytes.end(), part.begin(), part.end());
  };
  append(points.positions);
  append(points.colours);
  return bytes;
}

Json camera_json(const Camera& c) {
  return {{"rotation", c.rotation},    {"translation", c.translation}, {"focal", {c.fx, c.fy}},
          {"principal", {c.cx, c.cy}}, {"size", {c.width, c.height}},  {"time", c.time},
          {"extra", c.extra}};
}

Camera parse_camera(const Json& json) {
  Camera c;
  json.at("rotation").get_to(c.rotation);
  json.at("translation").get_to(c.translation);
  const auto focal = json.at("focal").get<std::array<double, 2>>();
  const auto principal = json.at("principal").get<std::array<double, 2>>();
  const auto size = json.at("size").get<std::array<int, 2>>();
  c.fx = focal[0], c.fy = focal[1];
  c.cx = principal[0], c.cy = principal[1];
  c.width = size[0], c.height = size[1];
  json.at("time").get_to(c.time);
  json.at("extra").get_to(c.extra);
  return c;
}

// BlockList builds the entries of the header for consecutive blocks. An entry contains the offset, the size
// and the CRC-32 of a block.
class BlockList {
 public:
  Json add(std::span<const std::byte> bytes) {
    const Json json{{"offset", offset_}, {"size", bytes.size()}, {"crc32", crc32(bytes)}};
    offset_ += bytes.size();
    return json;
  }

 private:
  std::uint64_t offset_ = 0;
};

Json view_json(const View& view, const Image8& image, BlockList& blocks) {
  Json json{{"name", view.name}, {"camera", camera_json(view.camera)}, {"image", nullptr}};
  if (!view.part_of.empty()) json["part_of"] = view.part_of, json["turn"] = view.turn_in_wide;
  if (image.rgb.empty()) return json;
  if (image.width != view.camera.width || image.height != view.camera.height)
    fail(ErrorKind::internal, "view '{}': the camera has {}x{} pixels, but the image has {}x{}", view.name,
         view.camera.width, view.camera.height, image.width, image.height);
  json["image"] = blocks.add(std::as_bytes(std::span(image.rgb)));
  if (view.opaque) json["opaque"] = true;
  if (!image.mask.empty()) json["mask"] = blocks.add(std::as_bytes(std::span(image.mask)));
  return json;
}

// Returns the description of a lens. Several camera models can have the same formula, and then the name of
// the first of them is stored.
Json lens_json(const WideLens& wide) {
  const Lens& lens = wide.lens;
  const auto model = std::ranges::find(lens_models(), lens.formula, &LensModel::formula);
  return {{"model", model->name},
          {"focal", {lens.fx, lens.fy}},
          {"principal", {lens.cx, lens.cy}},
          {"size", {lens.width, lens.height}},
          {"coefficients", lens.k},
          {"max_angle", wide.max_angle}};
}

WideLens parse_lens(const Json& json) {
  const auto name = json.at("model").get<std::string>();
  const auto model = std::ranges::find(lens_models(), name, &LensModel::name);
  if (model == lens_models().end()) throw std::runtime_error(fmt::format("unknown camera model '{}'", name));
  const auto focal = json.at("focal").get<std::array<double, 2>>();
  const auto principal = json.at("principal").get<std::array<double, 2>>();
  const auto size = json.at("size").get<std::array<int, 2>>();
  WideLens wide{{model->formula, focal[0], focal[1], principal[0], principal[1], size[0], size[1],
                 json.at("coefficients").get<LensCoefficients>()},
                json.at("max_angle").get<double>()};
  check_lens(wide.lens, "the lens of a wide image");
  if (size[0] < 1 || size[1] < 1) throw std::runtime_error("a wide image has no pixels");
  if (!(wide.max_angle > 0 && wide.max_angle <= std::numbers::pi))
    throw std::runtime_error("the largest angle of a wide image is not between 0 and 180 degrees");
  return wide;
}

Json wide_image_json(const View& view, const Image8& image, BlockList& blocks) {
  return {{"name", view.part_of},
          {"lens", lens_json(dynamic_cast<const StoredWideImage&>(*view.wide).lens())},
          {"image", blocks.add(std::as_bytes(std::span(image.rgb)))},
          {"mask", blocks.add(std::as_bytes(std::span(image.mask)))}};
}

// Calls visit(view, image, false) for each view of a split and its image. Then calls visit(view, image, true)
// for each wide image of the split, where `view` is the first view that shows a part of the wide image.
template <typename Visit>
void for_images(const Split& split, const Visit& visit) {
  for (const View& view : split.views) visit(view, view.load_image(), false);
  for (const auto& parts : views_by_image(split.views))
    if (const View& view = split.views[parts[0]]; view.wide) visit(view, view.wide->load(), true);
}

}  // namespace

void write_packed(const std::filesystem::path& path, const PackedData& data) {
  BlockList blocks;
  const std::vector<std::byte> points = data.points ? point_bytes(*data.points) : std::vector<std::byte>();
  Json header{{"background", data.background},     {"downscale", data.downscale}, {"offset", data.offset},
              {"depth_bounds", data.depth_bounds}, {"points", nullptr},           {"splits", Json::array()}};
  if (data.points) header["points"] = blocks.add(points);
  std::uint32_t file_version = kVersionPlain;
  for (const Split& split : data.splits) {
    Json views = Json::array(), wide_images = Json::array();
    for_images(split, [&](const View& view, const Image8& image, bool is_wide) {
      check_camera(view.camera, fmt::format("{}: not written: view '{}'", path.string(), view.name));
      if (!image.mask.empty()) file_version = std::max(file_version, kVersionMasked);
      if (is_wide)
        wide_images.push_back(wide_image_json(view, image, blocks));
      else
        views.push_back(view_json(view, image, blocks));
    });
    Json& json = header["splits"].emplace_back(Json{{"name", split.name}, {"views", std::move(views)}});
    if (wide_images.empty()) continue;
    json["wide_images"] = std::move(wide_images);
    file_version = kVersionWide;
  }
  const std::string text = json_text(header);
  Preamble preamble{{}, file_version, crc32(bytes_of(text)), text.size()};
  std::memcpy(preamble.magic, kPackedMagic, kMagicBytes);

  AtomicFile file(path);
  file.write(std::as_bytes(std::span(&preamble, 1)));
  file.write(text);
  file.write(points);
  BlockList written;
  written.add(points);
  for (std::size_t s = 0; s < data.splits.size(); ++s) {
    const Json& views = header["splits"][s]["views"];
    std::size_t i = 0;
    for_images(data.splits[s], [&](const View& view, const Image8& image, bool is_wide) {
      const bool same = is_wide ? wide_image_json(view, image, written) ==
                                      header["splits"][s]["wide_images"][i - views.size()]
                                : view_json(view, image, written) == views[i];
      ++i;
      if (!same)
        fail(ErrorKind::data,
             "{}: the file is not written, because the image of view '{}' changed during packing",
             path.string(), is_wide ? view.part_of : view.name);
      file.write(std::as_bytes(std::span(image.rgb)));
      file.write(std::as_bytes(std::span(image.mask)));
    });
  }
  file.commit();
}

bool is_packed(const std::filesystem::path& path) {
  if (!is_regular(path)) return false;
  char magic[kMagicBytes] = {};
  std::ifstream(path, std::ios::binary).read(magic, kMagicBytes);
  return std::memcmp(magic, kPackedMagic, kMagicBytes) == 0;
}

PackedFile::PackedFile(std::filesystem::path path) : path_(std::move(path)) {
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path_, size);
  Preamble preamble{};
  stream.read(reinterpret_cast<char*>(&preamble), sizeof preamble);
  if (!stream || std::memcmp(preamble.magic, kPackedMagic, kMagicBytes) != 0)
    fail(ErrorKind::data, "{}: not a packed data set (ubs pack writes one)", path_.string());
  if (preamble.version < kVersionPlain || preamble.version > kVersionWide)
    fail(ErrorKind::data,
         "{}: the format has version {}, but this program reads versions {} to {}: pack the data again",
         path_.string(), preamble.version, kVersionPlain, kVersionWide);
  if (preamble.header_bytes > size - sizeof preamble)
    fail(ErrorKind::data, "{}: the header is truncated", path_.string());
  std::string header(preamble.header_bytes, '\0');
  stream.read(header.data(), static_cast<std::streamsize>(header.size()));
  if (!stream || crc32(bytes_of(header)) != preamble.header_crc)
    fail(ErrorKind::data, "{}: the header is damaged (checksum)", path_.string());
  blocks_start_ = sizeof preamble + header.size();
  parse(header, size - blocks_start_);
}

void PackedFile::parse(const std::string& header, std::uint64_t blocks_bytes) {
  std::uint64_t used = 0, end = 0;
  const auto block = [&](const Json& json) -> std::optional<Block> {
    if (json.is_null()) return std::nullopt;
    const Block b{json.at("offset").get<std::uint64_t>(), json.at("size").get<std::uint64_t>(),
                  json.at("crc32").get<std::uint32_t>()};
    if (b.offset > blocks_bytes || b.size > blocks_bytes - b.offset)
      throw std::runtime_error("the file is truncated: a block is beyond its end");
    used += b.size, end = std::max(end, b.offset + b.size);
    return b;
  };
  const Json json = parse_own_json(header, path_.string());
  try {
    json.at("background").get_to(background_);
    json.at("downscale").get_to(downscale_);
    json.at("offset").get_to(offset_);
    json.at("depth_bounds").get_to(depth_bounds_);
    for (const double value : offset_) checked_input(value, "the offset");
    for (const auto& [near, far] : depth_bounds_)
      checked_input(near, "a depth"), checked_input(far, "a depth");
    points_ = block(json.at("points"));
    for (const Json& split : json.at("splits")) {
      PackedSplit& target = splits_.emplace_back();
      split.at("name").get_to(target.name);
      // The members are assigned one by one, because g++ 12 destroys a partly built aggregate twice if one of
      // its initialisers throws.
      for (const Json& view : split.at("views")) {
        PackedView packed;
        view.at("name").get_to(packed.view.name);
        packed.view.part_of = view.value("part_of", "");
        packed.view.turn_in_wide = view.value("turn", packed.view.turn_in_wide);
        const Camera& camera = packed.view.camera = parse_camera(view.at("camera"));
        check_camera(camera, fmt::format("view '{}'", packed.view.name));
        packed.pixels = {packed.view.name, camera.width, camera.height, block(view.at("image")), {}};
        if (view.contains("mask")) packed.pixels.mask = block(view.at("mask"));
        if (packed.pixels.mask && !packed.pixels.image)
          throw std::runtime_error("a view has a mask, but no image");
        packed.view.masked = packed.pixels.mask.has_value();
        packed.view.opaque = view.value("opaque", false);
        target.views.push_back(std::move(packed));
      }
      if (!split.contains("wide_images")) continue;
      for (const Json& wide : split["wide_images"]) {
        const WideLens lens = parse_lens(wide.at("lens"));
        const auto name = wide.at("name").get<std::string>();
        const std::optional<Block> image = block(wide.at("image")), mask = block(wide.at("mask"));
        if (!image || !mask) throw std::runtime_error("a wide image has no pixels");
        target.wide_images.push_back({lens, {name, lens.lens.width, lens.lens.height, image, mask}});
      }
    }
    // Blocks must not overlap or leave gaps. So their sizes must add up to the number of bytes after the
    // header, and the last block must end at the end of the file.
    if (used != blocks_bytes || end != blocks_bytes)
      throw std::runtime_error(
          used == blocks_bytes
              ? "blocks overlap or leave gaps"
              : fmt::format("the header describes blocks of {} bytes, but {} bytes follow it", used,
                            blocks_bytes));
  } catch (const std::exception& error) {  // from the JSON library, or thrown above
    fail(ErrorKind::data, "{}: the header is not valid: {}", path_.string(), error.what());
  }
}

std::vector<std::byte> PackedFile::read_block(const Block& block, const std::string& what) const {
  std::ifstream stream(path_, std::ios::binary);
  stream.seekg(static_cast<std::streamoff>(blocks_start_ + block.offset));
  std::vector<std::byte> bytes(block.size);
  stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!stream) fail(ErrorKind::data, "{}: cannot read {}", path_.string(), what);
  if (crc32(bytes) != block.crc)
    fail(ErrorKind::data, "{}: {} is damaged (checksum); copy or pack the data set again", path_.string(),
         what);
  return bytes;
}

std::vector<std::string> PackedFile::split_names() const {
  std::vector<std::string> names;
  for (const PackedSplit& s : splits_) names.push_back(s.name);
  return names;
}

const PackedFile::PackedSplit& PackedFile::find(const std::string& name) const {
  const auto found = std::ranges::find(splits_, name, &PackedSplit::name);
  if (found == splits_.end())
    fail(ErrorKind::data, "{}: the file contains no split '{}'", path_.string(), name);
  return *found;
}

Image8 PackedFile::load(const Pixels& pixels) const {
  const auto& [name, width, height, image_block, mask_block] = pixels;
  const std::vector<std::byte> bytes = read_block(*image_block, "the image of '" + name + "'");
  const std::size_t expected = 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (bytes.size() != expected)
    fail(ErrorKind::data, "{}: the image of '{}' has {} bytes, but {}x{} pixels need {}", path_.string(),
         name, bytes.size(), width, height, expected);
  Image8 image{width, height, std::vector<std::uint8_t>(bytes.size()), {}};
  std::memcpy(image.rgb.data(), bytes.data(), bytes.size());
  if (!mask_block) return image;
  const std::vector<std::byte> mask = read_block(*mask_block, "the mask of '" + name + "'");
  if (mask.size() != expected / 3)
    fail(ErrorKind::data, "{}: the mask of '{}' has {} bytes, but {}x{} pixels need {}", path_.string(), name,
         mask.size(), width, height, expected / 3);
  image.mask.resize(mask.size());
  std::memcpy(image.mask.data(), mask.data(), mask.size());
  return image;
}

class PackedFile::Source final : public ImageSource {
 public:
  Source(std::shared_ptr<const PackedFile> file, const Pixels& pixels)
      : file_(std::move(file)), pixels_(pixels) {}
  Image8 load() const override { return file_->load(pixels_); }

 private:
  std::shared_ptr<const PackedFile> file_;
  const Pixels& pixels_;  // a member of *file_
};

Split PackedFile::split(const std::string& name) const {
  Split split{name, {}};
  for (const PackedView& packed : find(name).views) split.views.push_back(packed.view);
  return split;
}

Split PackedFile::split_on_demand(const std::shared_ptr<const PackedFile>& file, const std::string& name) {
  const PackedSplit& found = file->find(name);
  std::map<std::string, std::shared_ptr<const WideImage>> wide_images;
  for (const PackedWideImage& packed : found.wide_images)
    wide_images[packed.pixels.name] = std::make_shared<StoredWideImage>(
        packed.lens, fmt::format("{}: {}", file->path_.string(), packed.pixels.name),
        std::make_shared<Source>(file, packed.pixels));
  Split split{name, {}};
  for (const PackedView& packed : found.views) {
    View& view = split.views.emplace_back(packed.view);
    if (packed.pixels.image) view.source = std::make_shared<Source>(file, packed.pixels);
    if (const auto wide = wide_images.find(view.part_of); wide != wide_images.end()) view.wide = wide->second;
  }
  return split;
}

bool PackedFile::opaque() const {
  return std::ranges::all_of(splits_, [](const PackedSplit& split) {
    return std::ranges::all_of(
        split.views, [](const PackedView& packed) { return packed.view.opaque || !packed.pixels.image; });
  });
}

std::optional<PointCloud> PackedFile::points() const {
  if (!points_) return std::nullopt;
  const std::vector<std::byte> bytes = read_block(*points_, "the point cloud");
  if (bytes.size() % kPointBytes != 0)
    fail(ErrorKind::data, "{}: the size of the point cloud is {} bytes, which is not a multiple of {}",
         path_.string(), bytes.size(), kPointBytes);
  PointCloud cloud;
  cloud.positions.resize(bytes.size() / kPointBytes);
  cloud.colours.resize(cloud.positions.size());
  const std::size_t split = cloud.positions.size() * 3 * sizeof(float);
  if (bytes.empty()) return cloud;
  std::memcpy(cloud.positions.data(), bytes.data(), split);
  std::memcpy(cloud.colours.data(), bytes.data() + split, bytes.size() - split);
  for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
    const auto& p = cloud.positions[i];
    check_point({p[0], p[1], p[2]}, i, path_.string());
  }
  return cloud;
}

LoadedScene load_packed(const std::filesystem::path& path, const DatasetOptions& options) {
  const auto file = std::make_shared<const PackedFile>(path);
  if (file->background() != options.background && !file->opaque())
    fail(ErrorKind::data,
         "{}: the images were packed with the background {}: use the same one (--background {}), or pack the "
         "data again",
         path.string(), fmt::join(file->background(), ","), fmt::join(file->background(), ","));
  if (options.read.downscale != 1 && options.read.downscale != file->downscale())
    fail(ErrorKind::data, "{}: the images were packed with --downscale {}, not {}: pack the data again",
         path.string(), file->downscale(), options.read.downscale);
  LoadedScene scene;
  if (options.read.downscale != 1)
    scene.report.note(
        fmt::format("--downscale {} has no effect, because the images were reduced when they "
                    "were packed",
                    options.read.downscale));
  for (const std::string& name : file->split_names())
    scene.splits.push_back(options.load_images ? PackedFile::split_on_demand(file, name) : file->split(name));
  if (scene.splits.empty()) fail(ErrorKind::data, "{}: the file contains no views", path.string());
  if (const auto points = file->points()) {
    WorldPoints& target = scene.points.emplace();
    for (const auto& p : points->positions) target.positions.push_back({p[0], p[1], p[2]});
    target.colours = points->colours;
  }
  scene.offset = file->offset();
  scene.depth_bounds = file->depth_bounds();
  const auto train = std::ranges::find(scene.splits, "train", &Split::name);
  if (!scene.depth_bounds.empty() &&
      (train == scene.splits.end() || train->views.size() != scene.depth_bounds.size()))
    fail(ErrorKind::data, "{}: the file has {} depth bounds, but must have one for each training view",
         path.string(), scene.depth_bounds.size());
  return scene;
}

}  // namespace ubs
