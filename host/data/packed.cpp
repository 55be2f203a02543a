// SPDX-License-Identifier: Apache-2.0
// See packed.hpp.
#include "host/data/packed.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <nlohmann/json.hpp>

#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/data/load_dataset.hpp"

namespace ubs {
namespace {

static_assert(std::endian::native == std::endian::little, "packed files are little-endian");

constexpr char kPackedMagic[] = "UBSDATA\x1a";
constexpr std::size_t kMagicBytes = 8;
constexpr std::uint32_t kPackedVersion = 2;  // with masks; data without masks are written as version 1
constexpr std::uint32_t kVersionUnmasked = 1;
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

// Builds the header's entries for consecutive blocks: offset, size and CRC-32 of each.
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
  if (!view.part_of.empty()) json["part_of"] = view.part_of;
  if (image.rgb.empty()) return json;
  if (image.width != view.camera.width || image.height != view.camera.height)
    fail(ErrorKind::internal, "view '{}': the camera has {}x{} pixels, but the image has {}x{}", view.name,
         view.camera.width, view.camera.height, image.width, image.height);
  json["image"] = blocks.add(std::as_bytes(std::span(image.rgb)));
  if (view.opaque) json["opaque"] = true;
  if (!image.mask.empty()) json["mask"] = blocks.add(std::as_bytes(std::span(image.mask)));
  return json;
}

}  // namespace

void write_packed(const std::filesystem::path& path, const PackedData& data) {
  BlockList blocks;
  const std::vector<std::byte> points = data.points ? point_bytes(*data.points) : std::vector<std::byte>();
  Json header{{"background", data.background},     {"downscale", data.downscale}, {"offset", data.offset},
              {"depth_bounds", data.depth_bounds}, {"points", nullptr},           {"splits", Json::array()}};
  if (data.points) header["points"] = blocks.add(points);
  bool masked = false;
  for (const Split& split : data.splits) {
    Json views = Json::array();
    for (const View& view : split.views) {
      check_camera(view.camera, fmt::format("{}: not written: view '{}'", path.string(), view.name));
      const Image8 image = view.load_image();
      masked = masked || !image.mask.empty();
      views.push_back(view_json(view, image, blocks));
    }
    header["splits"].push_back({{"name", split.name}, {"views", std::move(views)}});
  }
  const std::string text = json_text(header);
  Preamble preamble{{}, masked ? kPackedVersion : kVersionUnmasked, crc32(bytes_of(text)), text.size()};
  std::memcpy(preamble.magic, kPackedMagic, kMagicBytes);

  AtomicFile file(path);
  file.write(std::as_bytes(std::span(&preamble, 1)));
  file.write(text);
  file.write(points);
  BlockList written;
  written.add(points);
  for (std::size_t s = 0; s < data.splits.size(); ++s)
    for (std::size_t v = 0; v < data.splits[s].views.size(); ++v) {
      const View& view = data.splits[s].views[v];
      const Image8 image = view.load_image();
      if (view_json(view, image, written) != header["splits"][s]["views"][v])
        fail(ErrorKind::data,
             "{}: not written: the image of view '{}' changed while the data set was being packed",
             path.string(), view.name);
      file.write(std::as_bytes(std::span(image.rgb)));
      file.write(std::as_bytes(std::span(image.mask)));
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
  if (preamble.version < kVersionUnmasked || preamble.version > kPackedVersion)
    fail(ErrorKind::data,
         "{}: the format has version {}, but this program reads versions {} to {}: pack the data again",
         path_.string(), preamble.version, kVersionUnmasked, kPackedVersion);
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
      // Assigned member by member: if an initialiser throws, g++ 12 destroys a partly built aggregate twice.
      for (const Json& view : split.at("views")) {
        PackedView packed;
        view.at("name").get_to(packed.view.name);
        packed.view.part_of = view.value("part_of", "");
        packed.view.camera = parse_camera(view.at("camera"));
        check_camera(packed.view.camera, fmt::format("view '{}'", packed.view.name));
        packed.image = block(view.at("image"));
        if (view.contains("mask")) packed.mask = block(view.at("mask"));
        if (packed.mask && !packed.image) throw std::runtime_error("a mask without an image");
        packed.view.masked = packed.mask.has_value();
        packed.view.opaque = view.value("opaque", false);
        target.views.push_back(std::move(packed));
      }
    }
    // Blocks must not overlap or leave gaps: their sizes must add up to the size of the file after the
    // header, and the last block must end there.
    if (used != blocks_bytes || end != blocks_bytes)
      throw std::runtime_error(
          fmt::format("the header is followed by {} bytes, but its blocks have {}", blocks_bytes, used));
  } catch (const std::exception& error) {  // from the JSON library, or thrown above
    fail(ErrorKind::data, "{}: unusable header: {}", path_.string(), error.what());
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
  if (found == splits_.end()) fail(ErrorKind::data, "{}: has no split '{}'", path_.string(), name);
  return *found;
}

Image8 PackedFile::load(const PackedView& packed) const {
  const std::string& name = packed.view.name;
  const std::vector<std::byte> bytes = read_block(*packed.image, "the image of '" + name + "'");
  const Camera& c = packed.view.camera;
  const std::size_t expected = 3 * static_cast<std::size_t>(c.width) * static_cast<std::size_t>(c.height);
  if (bytes.size() != expected)
    fail(ErrorKind::data, "{}: the image of '{}' has {} bytes, but {}x{} pixels need {}", path_.string(),
         name, bytes.size(), c.width, c.height, expected);
  Image8 image{c.width, c.height, std::vector<std::uint8_t>(bytes.size()), {}};
  std::memcpy(image.rgb.data(), bytes.data(), bytes.size());
  if (!packed.mask) return image;
  const std::vector<std::byte> mask = read_block(*packed.mask, "the mask of '" + name + "'");
  if (mask.size() != expected / 3)
    fail(ErrorKind::data, "{}: the mask of '{}' has {} bytes, but {}x{} pixels need {}", path_.string(), name,
         mask.size(), c.width, c.height, expected / 3);
  image.mask.resize(mask.size());
  std::memcpy(image.mask.data(), mask.data(), mask.size());
  return image;
}

class PackedFile::Source final : public ImageSource {
 public:
  Source(std::shared_ptr<const PackedFile> file, const PackedView& view)
      : file_(std::move(file)), view_(view) {}
  Image8 load() const override { return file_->load(view_); }

 private:
  std::shared_ptr<const PackedFile> file_;
  const PackedView& view_;  // a view of file_
};

Split PackedFile::split(const std::string& name) const {
  Split split{name, {}};
  for (const PackedView& packed : find(name).views) split.views.push_back(packed.view);
  return split;
}

Split PackedFile::split_on_demand(const std::shared_ptr<const PackedFile>& file, const std::string& name) {
  const PackedSplit& found = file->find(name);
  Split split{name, {}};
  for (const PackedView& packed : found.views) {
    View& view = split.views.emplace_back(packed.view);
    if (packed.image) view.source = std::make_shared<Source>(file, packed);
  }
  return split;
}

bool PackedFile::opaque() const {
  return std::ranges::all_of(splits_, [](const PackedSplit& split) {
    return std::ranges::all_of(split.views,
                               [](const PackedView& packed) { return packed.view.opaque || !packed.image; });
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
  for (const std::string& name : file->split_names())
    scene.splits.push_back(options.load_images ? PackedFile::split_on_demand(file, name) : file->split(name));
  if (scene.splits.empty()) fail(ErrorKind::data, "{}: has no views", path.string());
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
