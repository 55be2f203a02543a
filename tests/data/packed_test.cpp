// SPDX-License-Identifier: Apache-2.0
// Tests packed data sets. Reading a file must restore the data that were packed, and any damage to a file
// must give an error of the kind data.
#include "host/dataset/packed.hpp"

#include <catch2/catch.hpp>

#include "host/base/crc32.hpp"
#include "host/base/file.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/wide_image_file.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

using test::get;
using test::message_of;
using test::put;
using test::TempFolder;

View make_view(const std::string& name, int width, int height, bool with_image) {
  View view;
  view.name = name;
  view.camera.rotation = {0, 1.0 + 4e-16, 1e-17, -1, 0, 1.0 / 3e9, 0, 0, 1};
  view.camera.translation = {-1, 2.5, 1e14 / 3};
  view.camera.fx = 12.345678901234567;
  view.camera.fy = 3;
  view.camera.cx = 0.5;
  view.camera.cy = 7;
  view.camera.width = width;
  view.camera.height = height;
  view.camera.time = 0.7;
  view.camera.extra = {1, -2};
  if (!with_image) return view;
  view.image = {width, height, {}};
  for (int i = 0; i < 3 * width * height; ++i)
    view.image.rgb.push_back(static_cast<std::uint8_t>(7 * i + width));
  return view;
}

PackedData make_data() {
  PackedData data;
  data.splits = {{"train", {make_view("r_0", 5, 4, true), make_view("r_1", 3, 7, true)}},
                 {"test", {make_view("a \"quoted\" name", 2, 2, false)}}};
  data.points = PointCloud{{{1, 2, 3}, {-4.5f, 0, 6}}, {{10, 20, 30}, {255, 0, 1}}};
  data.background = {1, 0.5, 0.25};
  data.downscale = 2;
  data.offset = {500000, -3, 0.5};
  data.depth_bounds = {{1, 2}, {3, 4.5}};
  return data;
}

std::uint32_t version_of(const std::filesystem::path& path) {
  std::uint32_t version;
  std::memcpy(&version, get(path).data() + 8, sizeof version);
  return version;
}

void read_everything(const std::filesystem::path& path) {
  const auto file = std::make_shared<const PackedFile>(path);
  for (const char* name : {"train", "test"})
    for (const View& view : PackedFile::split_on_demand(file, name).views) {
      view.load_image();
      if (view.wide) view.wide->load();
    }
  file->points();
}

TEST_CASE("CRC-32 of the check value is correct, computed at once or in parts", "[packed]") {
  const std::string text = "123456789";
  const auto bytes = std::as_bytes(std::span(text));
  CHECK(crc32(bytes) == 0xCBF43926u);
  CHECK(crc32(bytes.subspan(4), crc32(bytes.first(4))) == 0xCBF43926u);
  CHECK(crc32({}) == 0);
}

TEST_CASE("masks are restored, and a file with masks has version 2 instead of 1", "[packed]") {
  const TempFolder folder;
  PackedData data = make_data();
  write_packed(folder / "plain.ubsd", data);
  CHECK(version_of(folder / "plain.ubsd") == 1);
  Image8& masked = data.splits[0].views[1].image;
  for (int i = 0; i < 21; ++i) masked.mask.push_back(i % 3 == 0 ? 0 : 255);
  write_packed(folder / "set.ubsd", data);
  CHECK(version_of(folder / "set.ubsd") == 2);
  const auto file = std::make_shared<const PackedFile>(folder / "set.ubsd");
  const Split split = PackedFile::split_on_demand(file, "train");
  CHECK(!split.views[0].masked);
  CHECK(split.views[0].load_image().mask.empty());
  CHECK(split.views[1].masked);
  CHECK(split.views[1].load_image().mask == masked.mask);
  masked.mask.pop_back();
  write_packed(folder / "short.ubsd", data);
  CHECK_THAT(message_of([&] { read_everything(folder / "short.ubsd"); }), Catch::Contains("mask of 'r_1'"));
}

TEST_CASE("images that are decoded on demand are packed to the same bytes", "[packed]") {
  const TempFolder folder;
  PackedData data = make_data();
  data.splits[0].views[1].image.mask.assign(21, 255);
  write_packed(folder / "set.ubsd", data);
  const auto file = std::make_shared<const PackedFile>(folder / "set.ubsd");
  for (Split& split : data.splits) split = PackedFile::split_on_demand(file, split.name);
  REQUIRE(data.splits[0].views[0].image.rgb.empty());
  write_packed(folder / "again.ubsd", data);
  CHECK(read_text_file(folder / "again.ubsd") == read_text_file(folder / "set.ubsd"));
}

TEST_CASE("no file is written if an image changes while it is packed", "[packed]") {
  struct Changing : ImageSource {
    mutable std::uint8_t calls = 0;
    Image8 load() const override { return {5, 4, std::vector<std::uint8_t>(60, ++calls)}; }
  };
  const TempFolder folder;
  PackedData data = make_data();
  data.splits[0].views[0].source = std::make_shared<Changing>();
  CHECK_THAT(message_of([&] { write_packed(folder / "set.ubsd", data); }), Catch::Contains("'r_0' changed"));
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("a packed data set is restored without change", "[packed]") {
  const TempFolder folder;
  const PackedData data = make_data();
  write_packed(folder / "set.ubsd", data);
  CHECK(is_packed(folder / "set.ubsd"));
  const auto file = std::make_shared<const PackedFile>(folder / "set.ubsd");
  CHECK(file->background() == data.background);
  CHECK(file->downscale() == 2);
  CHECK(file->offset() == data.offset);
  CHECK(file->depth_bounds() == data.depth_bounds);
  CHECK(file->split_names() == std::vector<std::string>{"train", "test"});
  REQUIRE(file->points());
  CHECK(file->points()->positions == data.points->positions);
  CHECK(file->points()->colours == data.points->colours);
  for (const Split& expected : data.splits)
    for (const bool images : {true, false}) {
      const Split split =
          images ? PackedFile::split_on_demand(file, expected.name) : file->split(expected.name);
      REQUIRE(split.views.size() == expected.views.size());
      for (std::size_t i = 0; i < split.views.size(); ++i) {
        const View &view = split.views[i], &wanted = expected.views[i];
        CHECK(view.name == wanted.name);
        CHECK(view.part_of == wanted.part_of);
        CHECK(view.camera.rotation == wanted.camera.rotation);
        CHECK(view.camera.translation == wanted.camera.translation);
        CHECK(view.camera.fx == wanted.camera.fx);
        CHECK(view.camera.cy == wanted.camera.cy);
        CHECK(view.camera.width == wanted.camera.width);
        CHECK(view.camera.height == wanted.camera.height);
        CHECK(view.camera.time == wanted.camera.time);
        CHECK(view.camera.extra == wanted.camera.extra);
        CHECK(view.load_image().rgb == (images ? wanted.image.rgb : std::vector<std::uint8_t>()));
      }
    }
}

// Tests a manipulated file. Its names are dangerous because `render` writes "<name>.png" for each view.
TEST_CASE("names in a packed data set cannot lead out of a folder", "[packed]") {
  const TempFolder folder;
  PackedData data = make_data();
  data.splits[1].name = "../test";
  data.splits[0].views[0].name = "../../escaped";
  data.splits[0].views[1].name = "/tmp/absolute";
  for (Split& split : data.splits)
    for (View& view : split.views) view.camera.translation = {-1, 2.5, 3};
  write_packed(folder / "set.ubsd", data);
  const Dataset opened = load_dataset(folder / "set.ubsd", {.background = data.background});
  CHECK(opened.splits[0].views[0].name == "..%2F..%2Fescaped");
  CHECK(opened.splits[0].views[1].name == "%2Ftmp%2Fabsolute");
  CHECK(opened.splits[1].name == "..%2Ftest");
}

TEST_CASE("a packed data set is opened like any other, and keeps its offset", "[packed]") {
  const TempFolder folder;
  PackedData data = make_data();
  for (Split& split : data.splits)
    for (View& view : split.views) view.camera.translation = {-1, 2.5, 3};
  write_packed(folder / "set.ubsd", data);
  CHECK(detect_layout(folder / "set.ubsd") == "packed");
  for (const int cache_mb : {1024, 0}) {
    const Dataset opened = load_dataset(
        folder / "set.ubsd", {.read = {.image_cache_mb = cache_mb}, .background = data.background});
    CHECK(opened.offset == data.offset);
    CHECK(opened.depth_bounds == data.depth_bounds);
    REQUIRE(opened.points);
    CHECK(opened.points->positions == data.points->positions);
    REQUIRE(opened.find("train"));
    const View &view = opened.find("train")->views.at(1), &wanted = data.splits[0].views[1];
    CHECK((view.source != nullptr) == (cache_mb == 0));
    CHECK(view.load_image().rgb == wanted.image.rgb);
    CHECK(view.camera.translation == wanted.camera.translation);
    CHECK_FALSE(opened.find("test")->views.at(0).has_image());
  }
  CHECK(message_of([&] { load_dataset(folder / "set.ubsd"); }).find("--background 1,0.5,0.25") !=
        std::string::npos);
  CHECK(message_of([&] {
          load_dataset(folder / "set.ubsd", {.read = {.downscale = 3}, .background = data.background});
        }).find("--downscale 2") != std::string::npos);
  for (Split& split : data.splits)
    for (View& view : split.views) view.opaque = true;
  write_packed(folder / "opaque.ubsd", data);
  CHECK(load_dataset(folder / "opaque.ubsd").find("train")->views.at(1).opaque);
}

// By default, training uses no opacity penalty for views of wide images. So a packed file must record which
// views these are.
TEST_CASE("a packed data set cannot be read with another layout", "[packed]") {
  const TempFolder folder;
  PackedData data = make_data();
  data.background = {0, 0, 0};
  write_packed(folder / "set.ubsd", data);
  const auto load = [&](const ReadSettings& read) {
    return load_dataset(folder / "set.ubsd", {.read = read});
  };
  CHECK_THAT(message_of([&] { load({.layout = "nerfstudio"}); }, ErrorKind::usage),
             Catch::Contains("set.ubsd: this is a packed data set, so the layout cannot be nerfstudio"));
  const auto notes = [&](const ReadSettings& read) {
    return fmt::format("{}", fmt::join(load(read).report.notes, "\n"));
  };
  CHECK_THAT(notes({.layout = "packed"}), !Catch::Contains("downscale"));
  CHECK_THAT(notes({.downscale = 2}), Catch::Contains("--downscale 2 has no effect"));
}

TEST_CASE("a packed file records which views are parts of wide images", "[packed]") {
  const TempFolder folder;
  PackedData data = make_data();
  for (Split& split : data.splits)
    for (View& view : split.views) view.camera.translation = {-1, 2.5, 3};
  write_packed(folder / "ordinary.ubsd", data);
  CHECK(get(folder / "ordinary.ubsd").find("part_of") == std::string::npos);  // as in earlier versions
  data.splits[0].views[1].part_of = "ring/pano \xff";
  data.splits[0].views[1].turn_in_wide = {0, 0, 1, 0, 1, 0, -1, 0, 0};
  write_packed(folder / "wide.ubsd", data);
  CHECK(version_of(folder / "wide.ubsd") == 1);
  const auto file = std::make_shared<const PackedFile>(folder / "wide.ubsd");
  CHECK(file->split("train").views[1].part_of == "ring/pano \xff");
  CHECK(file->split("train").views[1].turn_in_wide == data.splits[0].views[1].turn_in_wide);
  for (const auto& [name, wide] : {std::pair("ordinary.ubsd", false), std::pair("wide.ubsd", true)}) {
    const Dataset opened = load_dataset(folder / name, {.background = data.background});
    INFO(name);
    CHECK(opened.find("train")->views.at(0).part_of.empty());
    CHECK(opened.find("train")->views.at(1).part_of.empty() != wide);
  }
}

// Gives the views of a split a wide image of 8x8 pixels, whose last row is masked.
void add_wide_image(Split& split) {
  struct Stripes : ImageSource {
    Image8 load() const override {
      Image8 image{8, 8, std::vector<std::uint8_t>(192, 90), std::vector<std::uint8_t>(64, 255)};
      for (std::size_t i = 56; i < 64; ++i) image.mask[i] = 0;
      return image;
    }
  };
  const auto wide =
      std::make_shared<StoredWideImage>(wide_lens("fisheye:200", 8, 8), "fish", std::make_shared<Stripes>());
  for (View& view : split.views) view.part_of = "fish", view.wide = wide;
}

TEST_CASE("wide images are restored with their lens, pixels and mask", "[packed]") {
  const TempFolder folder;
  PackedData data = make_data();
  add_wide_image(data.splits[0]);
  const WideImage& wide = *data.splits[0].views[0].wide;
  write_packed(folder / "set.ubsd", data);
  CHECK(version_of(folder / "set.ubsd") == 3);
  const auto file = std::make_shared<const PackedFile>(folder / "set.ubsd");
  const Split split = PackedFile::split_on_demand(file, "train");
  REQUIRE(split.views[0].wide);
  CHECK(split.views[1].wide == split.views[0].wide);
  CHECK(!PackedFile::split_on_demand(file, "test").views[0].wide);
  const WideImage& read = *split.views[0].wide;
  CHECK(dynamic_cast<const StoredWideImage&>(read).lens().lens ==
        dynamic_cast<const StoredWideImage&>(wide).lens().lens);
  CHECK(read.load().rgb == wide.load().rgb);
  CHECK(read.load().mask == wide.load().mask);
  CHECK(std::ranges::count(read.load().mask, 0) >= 8);
  CHECK(read.faces(Camera{}).size() == wide.faces(Camera{}).size());
  // A packed file can be packed again, to the same bytes.
  for (Split& again : data.splits) again = PackedFile::split_on_demand(file, again.name);
  write_packed(folder / "again.ubsd", data);
  CHECK(read_text_file(folder / "again.ubsd") == read_text_file(folder / "set.ubsd"));
}

TEST_CASE("every damaged byte of a packed file is detected", "[packed]") {
  const TempFolder folder;
  PackedData data = make_data();
  add_wide_image(data.splits[0]);
  write_packed(folder / "set.ubsd", data);
  const std::string good = get(folder / "set.ubsd");
  for (std::size_t at = 0; at < good.size(); ++at) {
    std::string bad = good;
    bad[at] = static_cast<char>(bad[at] ^ 0x10);
    put(folder / "bad.ubsd", bad);
    INFO("byte " << at << " of " << good.size());
    CHECK_FALSE(message_of([&] { read_everything(folder / "bad.ubsd"); }).empty());
  }
}

TEST_CASE("a truncated packed file is detected", "[packed]") {
  const TempFolder folder;
  write_packed(folder / "set.ubsd", make_data());
  const std::string good = get(folder / "set.ubsd");
  for (std::size_t size = 0; size < good.size(); ++size) {
    put(folder / "cut.ubsd", good.substr(0, size));
    INFO(size << " of " << good.size() << " bytes");
    CHECK_FALSE(message_of([&] { read_everything(folder / "cut.ubsd"); }).empty());
  }
}

TEST_CASE("files of other kinds are rejected, and the error contains their names", "[packed]") {
  const TempFolder folder;
  put(folder / "text.ubsd", "hello");
  CHECK_FALSE(is_packed(folder / "text.ubsd"));
  CHECK_FALSE(is_packed(folder.path()));
  CHECK_FALSE(is_packed(folder / "absent"));
  CHECK(message_of([&] { PackedFile file(folder / "text.ubsd"); }).find("text.ubsd") != std::string::npos);
  CHECK(message_of([&] { PackedFile file(folder / "absent"); }).find("absent") != std::string::npos);
  write_packed(folder / "set.ubsd", make_data());
  CHECK(message_of([&] { PackedFile(folder / "set.ubsd").split("val"); }).find("'val'") != std::string::npos);
}

}  // namespace
}  // namespace ubs
