// SPDX-License-Identifier: Apache-2.0
// Tests splat files that occur in practice: variations that other programs write, errors about files without
// splats, and notes about parts of a file that are not used.
#include <functional>
#include <map>
#include <nlohmann/json.hpp>

#include "host/formats/gaussian_model.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "host/formats/splat_series.hpp"
#include "host/formats/webp.hpp"
#include "host/formats/zip.hpp"
#include "host/settings/fields.hpp"
#include "tests/support/splats.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
using nlohmann::ordered_json;

namespace {

constexpr std::size_t kWholeMember = SIZE_MAX;  // our own archives need no limit

// Describes how a 3DGS PLY file differs from the standard one.
struct PlyKind {
  std::vector<std::string> header_lines = {};  // additional lines after the format line
  std::vector<std::string> extra = {};         // additional columns
  std::vector<std::string> without = {};       // missing columns
  std::string blank = {};                      // text at the end of each line of the header
  bool doubles = false, ascii = false;
  std::array<double, 3> origin{0, 0, 0};  // added to the positions
};

std::string ply_of(const ImportedSplats& s, const PlyKind& kind = {}) {
  std::vector<std::string> names{"x",       "y",      "z",      "nx",      "ny",      "nz",
                                 "f_dc_0",  "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
                                 "scale_2", "rot_0",  "rot_1",  "rot_2",   "rot_3"};
  for (const std::string& name : kind.without) std::erase(names, name);
  names.insert(names.end(), kind.extra.begin(), kind.extra.end());
  std::string text =
      fmt::format("ply{0}\nformat {1} 1.0{0}\n", kind.blank, kind.ascii ? "ascii" : "binary_little_endian");
  for (const std::string& line : kind.header_lines) text += line + "\n";
  text += fmt::format("element vertex {}{}\n", s.count(), kind.blank);
  for (const std::string& name : names)
    text += fmt::format("property {} {}{}\n", kind.doubles ? "double" : "float", name, kind.blank);
  text += "end_header" + kind.blank + "\n";
  for (std::size_t i = 0; i < s.count(); ++i) {
    for (const std::string& name : names) {
      const std::size_t k =
          name.back() >= '0' && name.back() <= '9' ? static_cast<std::size_t>(name.back() - '0') : 0;
      double v = 0.25;  // value of the additional columns
      if (name.size() == 1) v = s.positions[i][name[0] - 'x'] + kind.origin[name[0] - 'x'];
      if (name.starts_with("n")) v = 0;
      if (name.starts_with("f_dc")) v = s.sh[i * 3 * s.coefficients() + k];
      if (name == "opacity") v = s.opacity_logits[i];
      if (name.starts_with("scale_")) v = s.log_scales[i][k];
      if (name.starts_with("rot_")) v = s.rotations[i][k];
      if (kind.ascii) {
        text += fmt::format("{} ", v);
      } else if (kind.doubles) {
        text.append(reinterpret_cast<const char*>(&v), sizeof v);
      } else {
        const auto f = static_cast<float>(v);
        text.append(reinterpret_cast<const char*>(&f), sizeof f);
      }
    }
    if (kind.ascii) text += "\n";
  }
  return text;
}

std::string all_of(const std::vector<std::string>& remarks) {
  return fmt::format("{}", fmt::join(remarks, "\n"));
}

std::string remarks_of(const std::filesystem::path& path) { return all_of(load_splat_model(path).remarks); }

// Returns a glTF file with a modified JSON chunk.
std::string changed_glb(const std::string& file, const std::function<void(ordered_json&)>& change) {
  std::uint32_t size = 0;
  std::memcpy(&size, file.data() + 12, sizeof size);
  ordered_json document = ordered_json::parse(file.substr(20, size));
  change(document);
  std::string text = document.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const auto word = [](std::size_t v) {
    const auto number = static_cast<std::uint32_t>(v);
    return std::string(reinterpret_cast<const char*>(&number), sizeof number);
  };
  const std::string rest = file.substr(20 + size);
  return file.substr(0, 8) + word(20 + text.size() + rest.size()) + word(text.size()) + file.substr(16, 4) +
         text + rest;
}

// Returns the numbers of a glTF file.
std::string numbers_of_glb(const std::string& file) {
  std::uint32_t size = 0;
  std::memcpy(&size, file.data() + 12, sizeof size);
  return file.substr(28 + size);
}

// Returns a data URI in base64.
std::string data_uri(const std::string& bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out = "data:application/octet-stream;base64,";
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : bytes) {
    bits = bits << 8 | static_cast<unsigned char>(c);
    for (count += 8; count >= 6; count -= 6) out += kDigits[bits >> (count - 6) & 63];
  }
  if (count > 0) out += kDigits[bits << (6 - count) & 63];
  while ((out.size() - out.find(',') - 1) % 4 != 0) out += '=';
  return out;
}

// Returns splats as a text file of glTF whose numbers are in a data URI.
std::string gltf_text(const ImportedSplats& splats, const std::function<void(ordered_json&)>& change = {}) {
  const TempFolder folder;
  write_glb(folder / "a.glb", splats);
  const std::string file = get(folder / "a.glb");
  std::uint32_t size = 0;
  std::memcpy(&size, file.data() + 12, sizeof size);
  ordered_json document = ordered_json::parse(file.substr(20, size));
  document["buffers"][0]["uri"] = data_uri(numbers_of_glb(file));
  if (change) change(document);
  return document.dump();
}

// Returns the glTF file with other values of one attribute of its only primitive.
std::string with_values(std::string file, const std::string& attribute, const std::vector<float>& values) {
  std::uint32_t size = 0;
  std::memcpy(&size, file.data() + 12, sizeof size);
  const ordered_json document = ordered_json::parse(file.substr(20, size));
  const auto accessor =
      document["meshes"][0]["primitives"][0]["attributes"]["KHR_gaussian_splatting:" + attribute];
  const std::size_t at =
      28 + size + document["bufferViews"][accessor.get<std::size_t>()]["byteOffset"].get<std::size_t>();
  std::memcpy(file.data() + at, values.data(), values.size() * sizeof(float));
  return file;
}

std::vector<std::byte> bytes_of(const std::string& text) {
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}
std::string text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::string zip_of(const std::vector<std::pair<std::string, std::string>>& members) {
  ZipWriter zip;
  for (const auto& [name, text] : members) zip.add(name, bytes_of(text));
  return text_of(zip.finish());
}

std::vector<std::pair<std::string, std::string>> members_of(const std::filesystem::path& path) {
  const std::string file = get(path);
  const ZipReader zip(std::as_bytes(std::span(file)), "test");
  std::vector<std::pair<std::string, std::string>> members;
  for (const std::string& name : zip.names())
    members.emplace_back(name, text_of(zip.get(name, kWholeMember)));
  return members;
}

// Writes the files of a SOG archive into a folder.
void put_sog_folder(const std::filesystem::path& folder, const ImportedSplats& splats) {
  const TempFolder temporary;
  write_sog(temporary / "a.sog", splats);
  for (const auto& [name, text] : members_of(temporary / "a.sog")) put(folder / name, text);
}

ImportedSplats splats_at(double x, std::size_t count, int degree = 0) {
  ImportedSplats splats = random_splats(count, degree);
  for (auto& p : splats.positions) p[0] += static_cast<float>(x);
  return splats;
}

// Returns the number of splats whose x coordinate differs from `x` by less than 4.
std::size_t count_near(const ImportedSplats& splats, double x) {
  return static_cast<std::size_t>(
      std::ranges::count_if(splats.positions, [x](const auto& p) { return std::abs(p[0] - x) < 4; }));
}

// Returns SuperSplat's compressed PLY with one splat and an additional column.
std::string compressed_ply(const std::string& header_line, const std::string& column) {
  std::string text = "ply\nformat binary_little_endian 1.0\n" + header_line + "element chunk 1\n";
  for (const char* what : {"x", "y", "z", "scale_x", "scale_y", "scale_z"})
    for (const char* end : {"min", "max"}) text += fmt::format("property float {}_{}\n", end, what);
  text += "element vertex 1\n";
  for (const char* what : {"position", "rotation", "scale", "color"})
    text += fmt::format("property uint packed_{}\n", what);
  text += column + "end_header\n";
  for (int k = 0; k < 12; ++k) {
    const float bound = k % 2 == 0 ? -3.0f : -1.0f;
    text.append(reinterpret_cast<const char*>(&bound), sizeof bound);
  }
  for (int k = 0; k < 4; ++k) text.append("\x7f\x20\x40\x3f", 4);
  return text + (column.empty() ? "" : std::string(4, '\0'));
}

}  // namespace

TEST_CASE("kinds: spaces in the header, ascii rows and other number types are read", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(20, 0);
  for (const PlyKind& kind : {PlyKind{.blank = " "}, PlyKind{.blank = " \t\r"}, PlyKind{.ascii = true},
                              PlyKind{.blank = "  ", .doubles = true}}) {
    put(folder / "a.ply", ply_of(splats, kind));
    CHECK(detect_splat_format(folder / "a.ply").name == "3dgs");
    const ImportedSplats back = read_foreign_splats(folder / "a.ply");
    CHECK(back.positions == splats.positions);
    CHECK(back.sh == splats.sh);
    CHECK(back.report.notes.empty());
  }
  put(folder / "point.ply", replaced(ply_of(splats), "element vertex", "element point"));
  CHECK(read_foreign_splats(folder / "point.ply").positions == splats.positions);
  std::string wide = compressed_ply("", "");
  for (const char* word : {"element chunk", "element vertex", "property uint"})
    wide = replaced(wide, word, std::string(word) + "  ");
  put(folder / "c.ply", wide);
  CHECK(detect_splat_format(folder / "c.ply").name == "compressed");
  CHECK(read_foreign_splats(folder / "c.ply").count() == 1);
}

TEST_CASE("kinds: flat splats are kept, with a scale close to 0", "[formats]") {
  const TempFolder folder;
  ImportedSplats splats = random_splats(30, 0);
  const auto expect_discs = [&](const ImportedSplats& read, const char* what) {
    INFO(what);
    REQUIRE(read.count() == 30);
    CHECK(read.report.skipped.empty());
    for (std::size_t i = 0; i < 30; ++i) CHECK(read.log_scales[i][2] == kFlatLogScale);
    CHECK(read.log_scales[4][1] == splats.log_scales[4][1]);
    for (const float v : exact_model(read).values) CHECK(std::isfinite(v));
  };
  for (const float tiny : {-INFINITY, -46.0f, -1e30f}) {
    for (auto& s : splats.log_scales) s[2] = tiny;
    put(folder / "a.ply", ply_of(splats));
    expect_discs(read_foreign_splats(folder / "a.ply"), "log scale");
  }
  put(folder / "2dgs.ply", ply_of(splats, {.without = {"scale_2"}}));
  expect_discs(read_foreign_splats(folder / "2dgs.ply"), "2DGS");
  CHECK_THAT(remarks_of(folder / "2dgs.ply"), Contains("splats are flat"));
  // A file that lacks more than the third scale is not a 2DGS file.
  put(folder / "no.ply", ply_of(splats, {.without = {"scale_2", "rot_3"}}));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "no.ply"); }), Contains("'scale_2' is missing"));

  for (auto& s : splats.log_scales) s[2] = -3;
  write_glb(folder / "a.glb", splats);
  std::vector<float> scales;
  for (const auto& s : splats.log_scales) scales.insert(scales.end(), {std::exp(s[0]), std::exp(s[1]), 0.0f});
  put(folder / "flat.glb", with_values(get(folder / "a.glb"), "SCALE", scales));
  const ImportedSplats glb = read_foreign_splats(folder / "flat.glb");
  REQUIRE(glb.count() == 30);
  CHECK(glb.log_scales[7][2] == kFlatLogScale);

  write_splat32(folder / "a.splat", splats);
  std::string records = get(folder / "a.splat");
  for (std::size_t i = 0; i < 30; ++i) records.replace(32 * i + 20, 4, 4, '\0');
  put(folder / "flat.splat", records);
  CHECK(read_foreign_splats(folder / "flat.splat").count() == 30);

  // Splats whose scale is NaN or infinite are dropped.
  splats.log_scales[3][0] = NAN, splats.log_scales[4][0] = INFINITY;
  put(folder / "a.ply", ply_of(splats));
  CHECK(read_foreign_splats(folder / "a.ply").count() == 28);
}

TEST_CASE("kinds: files of other tools and of ubs record whether a model was trained with antialiasing",
          "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(5, 1);
  const std::pair<std::vector<std::string>, bool> kinds[] = {
      {{}, false},
      {{"comment SplatRenderMode: mip"}, true},
      {{"comment  splatrendermode:MIP "}, true},
      {{"comment SplatRenderMode: default"}, false},
      {{"comment antialiased 1"}, true},
      {{"comment antialiased 0"}, false},
      {{"obj_info antialiased 1"}, true},
      {{"comment antialiased 1", "comment SplatRenderMode: default"}, false},
      {{"comment SplatRenderMode: default", "comment antialiased 1"}, true},
      {{"comment antialiased_by_nobody 1"}, false}};
  for (const auto& [lines, antialiased] : kinds) {
    INFO(all_of(lines));
    put(folder / "a.ply", ply_of(splats, {.header_lines = lines}));
    const LoadedModel loaded = load_splat_model(folder / "a.ply");
    CHECK((loaded.model.variant().antialias == Antialias::on) == antialiased);
    CHECK(loaded.remarks.empty() == !antialiased);
  }
  put(folder / "a.ply", ply_of(splats, {.header_lines = {"comment SplatRenderMode: banana"}}));
  CHECK_THAT(remarks_of(folder / "a.ply"), Contains("banana"));
  put(folder / "c.ply", compressed_ply("comment SplatRenderMode: mip\n", ""));
  CHECK(read_foreign_splats(folder / "c.ply").antialiased);

  ImportedSplats trained = splats;
  CHECK(format_remarks(splat_format("3dgs"), trained).empty());
  trained.antialiased = true;
  CHECK(format_remarks(splat_format("3dgs"), trained).empty());
  write_gaussian_ply(folder / "b.ply", trained);
  CHECK(read_foreign_splats(folder / "b.ply").antialiased);
  // One of the two comments must be sufficient, because other programs only read one of them.
  const std::string written = get(folder / "b.ply");
  for (const std::string comment : {"comment SplatRenderMode: mip\n", "comment antialiased 1\n"}) {
    INFO(comment);
    REQUIRE(written.find(comment) != std::string::npos);
    put(folder / "c.ply", replaced(written, comment, ""));
    CHECK(read_foreign_splats(folder / "c.ply").antialiased);
  }
  write_gaussian_ply(folder / "b.ply", splats);
  CHECK_FALSE(read_foreign_splats(folder / "b.ply").antialiased);
  CHECK(get(folder / "b.ply").find("comment") == std::string::npos);
  // Newer SOG files use another key to record antialiasing.
  write_sog(folder / "a.sog", splats);
  auto members = members_of(folder / "a.sog");
  for (auto& [name, text] : members)
    if (name == "meta.json") text = replaced(text, "\"antialias\":false", "\"model\":\"antialiased\"");
  put(folder / "m.sog", zip_of(members));
  CHECK(read_foreign_splats(folder / "m.sog").antialiased);
}

TEST_CASE("kinds: double-precision coordinates far away are stored relative to an offset", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(200, 0);
  const std::array<double, 3> utm{500123.4, 4649776.25, 100};
  put(folder / "a.ply", ply_of(splats, {.doubles = true, .origin = utm}));
  const LoadedModel loaded = load_splat_model(folder / "a.ply");
  CHECK_THAT(all_of(loaded.remarks), Contains("far from the origin"));
  const SplatModel& model = loaded.model.groups.front();
  for (int k = 0; k < 3; ++k) {
    CHECK(loaded.offset[k] == std::round(loaded.offset[k]));
    for (std::size_t i = 0; i < 200; ++i)
      CHECK(std::abs(model.row(model.layout().xyz + k)[i] + loaded.offset[k] - splats.positions[i][k] -
                     utm[k]) < 1e-6);
  }
  // All digits of an ascii file are used, although its header states float.
  put(folder / "t.ply", ply_of(splats, {.ascii = true, .origin = utm}));
  CHECK(load_splat_model(folder / "t.ply").model.groups.front().values == model.values);
  // The offset of the file is added. Splats far away, such as a sky, do not influence the position of the
  // scene.
  ImportedSplats sky = splats;
  for (std::size_t i = 0; i < 60; ++i) sky.positions[i][2] = 1e7f;
  put(folder / "b.ply",
      ply_of(sky, {.header_lines = {"comment ubs_offset 1000 0 0"}, .doubles = true, .origin = utm}));
  const ImportedSplats far = read_foreign_splats(folder / "b.ply");
  CHECK(std::abs(far.positions[100][1] + far.offset[1] - splats.positions[100][1] - utm[1]) < 1e-6);
  CHECK(std::abs(far.positions[100][0] + far.offset[0] - splats.positions[100][0] - utm[0] - 1000) < 1e-6);
  // Coordinates near the origin get no offset.
  put(folder / "c.ply", ply_of(splats, {.doubles = true}));
  CHECK(read_foreign_splats(folder / "c.ply").offset == std::array<double, 3>{});
}

TEST_CASE("kinds: SPZ without gzip is read", "[formats]") {
  const TempFolder folder;
  write_spz(folder / "a.spz", random_splats(40, 2));
  const std::string packed = get(folder / "a.spz");
  put(folder / "raw.spz", text_of(inflate_gzip(std::as_bytes(std::span(packed)), 1 << 20, "test")));
  const ImportedSplats a = read_foreign_splats(folder / "a.spz"), b = read_foreign_splats(folder / "raw.spz");
  CHECK(a.positions == b.positions);
  CHECK(a.sh == b.sh);
}

TEST_CASE("kinds: SOG is read from a folder, from meta.json, and from a folder in an archive", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(50, 1);
  write_sog(folder / "a.sog", splats);
  put_sog_folder(folder / "sog", splats);
  const ImportedSplats whole = read_foreign_splats(folder / "a.sog");
  CHECK(find_splat_model(folder / "sog") == folder / "sog/meta.json");
  for (const LoadedModel& loaded :
       {load_splat_model(folder / "sog"), load_splat_model(folder / "sog/meta.json")}) {
    CHECK(loaded.format->name == "sog");
    CHECK(loaded.model.groups.front().values == exact_model(whole).values);
    CHECK(loaded.remarks.empty());
  }
  auto members = members_of(folder / "a.sog");
  for (auto& [name, text] : members) name = "scene/" + name;
  put(folder / "deep.sog", zip_of(members));
  CHECK(read_foreign_splats(folder / "deep.sog").positions == whole.positions);

  const std::string meta = get(folder / "sog/meta.json");
  put(folder / "sog/meta.json", replaced(meta, "\"quats.webp\"", "\"../quats.webp\""));
  CHECK_THAT(message_of([&] { load_splat_model(folder / "sog"); }), Contains("'../quats.webp'"));
  put(folder / "sog/meta.json", replaced(meta, "\"quats.webp\"", "\"gone.webp\""));
  CHECK_THAT(message_of([&] { load_splat_model(folder / "sog"); }), Contains("gone.webp"));
  for (const char* group : {"scales", "sh0", "shN"}) {
    ordered_json broken = ordered_json::parse(meta);
    broken[group]["codebook"][17] = nullptr;
    put(folder / "sog/meta.json", broken.dump());
    CHECK_THAT(message_of([&] { load_splat_model(folder / "sog"); }),
               Contains(fmt::format("meta.json: {}.codebook[17] is null", group)));
  }
  ordered_json broken = ordered_json::parse(meta);
  broken["means"]["maxs"][2] = nullptr;
  put(folder / "sog/meta.json", broken.dump());
  CHECK_THAT(message_of([&] { load_splat_model(folder / "sog"); }), Contains("means.maxs[2] is null"));
  // A data folder may also contain a file with this name.
  put(folder / "data/meta.json", R"({"frames": []})");
  CHECK(find_splat_model(folder / "data").empty());
}

TEST_CASE("kinds: SOG version 1 is read", "[formats]") {
  const TempFolder folder;
  const auto image = [](std::vector<std::uint8_t> rgba, int width) {
    const int height = static_cast<int>(rgba.size()) / 4 / width;
    return text_of(encode_webp({width, height, std::move(rgba)}));
  };
  // The file has two splats. The palette of degree 1 is 192 pixels wide. Splat 1 uses entry 65, which is the
  // second entry of the second row.
  std::vector<std::uint8_t> palette(4 * 192 * 2, 255), labels{0, 0, 0, 255, 65, 0, 0, 255};
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t c = 0; c < 3; ++c)
      palette[4 * (192 + 3 + k) + c] = static_cast<std::uint8_t>(51 * k + c);
  const ordered_json meta{
      {"means",
       {{"shape", {2, 3}},
        {"dtype", "float32"},
        {"mins", {-1, 0, 0}},
        {"maxs", {1, 2, 0}},
        {"files", {"l", "u"}}}},
      {"scales", {{"shape", {2, 3}}, {"mins", {-5, -4, -3}}, {"maxs", {0, -2, -3}}, {"files", {"s"}}}},
      {"quats", {{"shape", {2, 4}}, {"encoding", "quaternion_packed"}, {"files", {"q"}}}},
      {"sh0", {{"shape", {2, 1, 4}}, {"mins", {-1, 0, 0, -2}}, {"maxs", {1, 1, 2, 3}}, {"files", {"c"}}}},
      {"shN", {{"shape", {2, 9}}, {"mins", -1}, {"maxs", 4}, {"quantization", 8}, {"files", {"p", "n"}}}}};
  put(folder / "v1.sog", zip_of({{"meta.json", meta.dump()},
                                 {"l", image({0, 255, 0, 255, 255, 255, 0, 255}, 2)},
                                 {"u", image({0, 255, 0, 255, 255, 255, 0, 255}, 2)},
                                 {"s", image({0, 0, 0, 255, 255, 51, 0, 255}, 2)},
                                 {"q", image({128, 128, 128, 252, 128, 128, 128, 253}, 2)},
                                 {"c", image({0, 0, 255, 51, 255, 255, 255, 255}, 2)},
                                 {"p", image(palette, 192)},
                                 {"n", image(labels, 2)}}));
  const ImportedSplats s = read_foreign_splats(folder / "v1.sog");
  CHECK(s.report.layout == "SOG version 1");
  REQUIRE(s.count() == 2);
  REQUIRE(s.sh_degree == 1);
  CHECK(s.positions[0][0] == Approx(1 - std::exp(1.0)));
  CHECK(s.positions[1][1] == Approx(std::exp(2.0) - 1));
  CHECK(s.log_scales[1][0] == Approx(0).margin(1e-6));
  CHECK(s.log_scales[1][1] == Approx(-3.6));
  CHECK(s.log_scales[1][2] == -3);
  CHECK(s.sh[0] == -1);
  CHECK(s.sh[2] == 2);
  CHECK(s.opacity_logits[0] == Approx(-1));
  CHECK(s.opacity_logits[1] == Approx(3));
  CHECK(std::abs(s.rotations[1][1]) > 0.99f);
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t c = 0; c < 3; ++c)
      CHECK(s.sh[12 + 3 * (k + 1) + c] ==
            Approx(-1 + 5 * (51.0 * static_cast<double>(k) + static_cast<double>(c)) / 255).margin(1e-6));
  put(folder / "v3.sog", zip_of({{"meta.json", R"({"version": 3, "count": 1, "means": {}, "quats": {}})"}}));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "v3.sog"); }), Contains("SOG version 3"));
}

TEST_CASE("kinds: the finest level and the environment of a streamed SOG are read", "[formats]") {
  const TempFolder folder;
  put_sog_folder(folder / "s/0_0", splats_at(0, 30, 1));
  put_sog_folder(folder / "s/0_1", splats_at(100, 20, 1));
  put_sog_folder(folder / "s/1_0", splats_at(200, 10));
  write_sog(folder / "s/env.sog", splats_at(300, 5));
  const auto range = [](int file, int offset, int count) {
    return ordered_json{{"file", file}, {"offset", offset}, {"count", count}};
  };
  const ordered_json meta{{"lodLevels", 2},
                          {"environment", "env.sog"},
                          {"filenames", {"0_0/meta.json", "0_1/meta.json", "1_0/meta.json"}},
                          {"tree",
                           {{"children",
                             {{{"lods", {{"0", range(0, 10, 20)}, {"1", range(2, 0, 5)}}}},
                              {{"lods", {{"0", range(1, 0, 20)}, {"1", range(2, 5, 5)}}}},
                              {{"children", {{{"lods", {{"0", range(0, 0, 10)}}}}}}}}}}}};
  put(folder / "s/lod-meta.json", meta.dump());
  for (const char* name : {"s", "s/lod-meta.json"}) {
    const LoadedModel loaded = load_splat_model(folder / name);
    CHECK(loaded.format->name == "streamed-sog");
    CHECK(loaded.model.count() == 55);
    CHECK_THAT(all_of(loaded.remarks),
               Contains("level 0 of 2, the finest, from 2 files, and the environment"));
  }
  const ImportedSplats splats = read_foreign_splats(folder / "s/lod-meta.json");
  CHECK(count_near(splats, 0) == 30);
  CHECK(count_near(splats, 100) == 20);
  CHECK(count_near(splats, 300) == 5);
  CHECK(splats.sh_degree == 1);

  const auto message = [&](const std::function<void(ordered_json&)>& change) {
    ordered_json other = meta;
    change(other);
    put(folder / "s/lod-meta.json", other.dump());
    return message_of([&] { load_splat_model(folder / "s"); });
  };
  const auto first = [](ordered_json& m) -> ordered_json& { return m["tree"]["children"][0]["lods"]["0"]; };
  CHECK_THAT(message([&](ordered_json& m) { first(m)["count"] = 21; }), Contains("10 to 31"));
  CHECK_THAT(message([&](ordered_json& m) { first(m)["offset"] = 9; }), Contains("9 to 29"));
  CHECK_THAT(message([&](ordered_json& m) { first(m)["file"] = 3; }),
             Contains("file 3, but only the files 0 to 2 are listed"));
  CHECK_THAT(message([&](ordered_json& m) { m["filenames"][0] = "/etc/passwd"; }), Contains("'/etc/passwd'"));
  CHECK_THAT(message([&](ordered_json& m) { m["tree"] = ordered_json::object(); }),
             Contains("no level of detail"));
}

TEST_CASE("kinds: glTF with logarithms or logits is distinguished from glTF that follows the extension",
          "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(40, 0);
  write_glb(folder / "a.glb", splats);
  const std::string file = get(folder / "a.glb");
  std::vector<float> logs, mixed(120, 0.1f);
  for (const auto& s : splats.log_scales) logs.insert(logs.end(), s.begin(), s.end());
  mixed[5] = -0.25f;
  put(folder / "logs.glb", with_values(file, "SCALE", logs));
  const ImportedSplats back = read_foreign_splats(folder / "logs.glb");
  CHECK(back.log_scales == splats.log_scales);
  CHECK_THAT(remarks_of(folder / "logs.glb"), Contains("accessor 2 (SCALE)") && Contains("as logarithms"));
  put(folder / "mixed.glb", with_values(file, "SCALE", mixed));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "mixed.glb"); }),
             Contains("accessor 2 (SCALE): scales from -0.25 to 0.1"));
  put(folder / "logits.glb", with_values(file, "OPACITY", splats.opacity_logits));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "logits.glb"); }),
             Contains("accessor 3 (OPACITY): opacities from -") && Contains("0 to 1"));
}

TEST_CASE("transforms: nodes of glTF rotate, scale, mirror and distort splats with their colours",
          "[formats]") {
  const TempFolder folder;
  for (const int degree : {0, 1, 2, 3}) {
    INFO(degree);
    ImportedSplats splats = random_splats(30, degree);
    splats.log_scales[3][1] = kFlatLogScale;  // a disc
    write_glb(folder / "a.glb", splats);
    const auto with = [&](const ordered_json& node) {
      put(folder / "b.glb",
          changed_glb(get(folder / "a.glb"), [&](ordered_json& j) { j["nodes"][0] = node; }));
      return read_foreign_splats(folder / "b.glb");
    };
    const std::array<double, 4> q{0.5, -0.3, 0.7, 0.2};
    const Mat3 turn = turn_matrix(q);
    const double n = std::sqrt(0.25 + 0.09 + 0.49 + 0.04);
    const ordered_json rotation{q[1] / n, q[2] / n, q[3] / n, q[0] / n};
    const auto scaled = [&](double x, double y, double z) {
      Mat3 m = turn;
      for (auto& row : m) row[0] *= x, row[1] *= y, row[2] *= z;
      return m;
    };
    const auto check = [&](const ordered_json& node, const Mat3& m, const Vec3& move, bool similar) {
      INFO(node.dump());
      const ImportedSplats back = with(node);
      CHECK(back.report.skipped.empty());
      CHECK(check_transformed(splats, back, m, move, similar) < 2e-6);
      CHECK(back.report.notes.empty() == (similar || degree == 0));
      CHECK(back.log_scales[3][0] > -20);
      CHECK(std::ranges::min(back.log_scales[3]) < -30);
    };
    check({{"mesh", 0}, {"rotation", rotation}}, turn, {0, 0, 0}, true);
    check({{"mesh", 0}, {"rotation", rotation}, {"scale", {2.5, 2.5, 2.5}}, {"translation", {1, 2, 3}}},
          scaled(2.5, 2.5, 2.5), {1, 2, 3}, true);
    check({{"mesh", 0}, {"rotation", rotation}, {"scale", {-1, 1, 1}}}, scaled(-1, 1, 1), {0, 0, 0}, true);
    check({{"mesh", 0}, {"scale", {-0.5, -0.5, -0.5}}}, turn_matrix({1, 0, 0, 0}, -0.5), {0, 0, 0}, true);
    check({{"mesh", 0}, {"rotation", rotation}, {"scale", {0.5, 2, 1}}}, scaled(0.5, 2, 1), {0, 0, 0}, false);
    // A matrix is stored column by column. This one has a shear.
    check({{"mesh", 0}, {"matrix", {1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 4, 5, 6, 1}}},
          Mat3{{{1, 0.5, 0}, {0, 1, 0}, {0, 0, 1}}}, {4, 5, 6}, false);
    // Half a turn about x: the same axes as in the file before it was written.
    const ImportedSplats half = with({{"mesh", 0}, {"rotation", {1, 0, 0, 0}}});
    for (std::size_t k = 0; k < half.sh.size(); ++k) {
      const std::size_t coefficient = k / 3 % half.coefficients();
      const float sign = coefficient == 0 ? 1.0f : kHalfTurnSigns[coefficient - 1];
      CHECK(half.sh[k] == Approx(sign * splats.sh[k]).margin(1e-7));
    }
  }
}

TEST_CASE("transforms: nodes of glTF form a hierarchy and show meshes several times", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(20, 2);
  write_glb(folder / "a.glb", splats);
  const auto with = [&](const std::function<void(ordered_json&)>& change) {
    put(folder / "b.glb", changed_glb(get(folder / "a.glb"), change));
    return read_foreign_splats(folder / "b.glb");
  };
  const auto nodes = [&](const ordered_json& list, const ordered_json& roots) {
    return with([&](ordered_json& j) {
      j["nodes"] = list;
      if (roots.is_null())
        j.erase("scenes"), j.erase("scene");
      else
        j["scenes"] = {{{"nodes", roots}}};
    });
  };
  const auto refusal = [&](const ordered_json& list, const ordered_json& roots) {
    return message_of([&] { nodes(list, roots); });
  };
  const double h = std::sqrt(0.5);
  // The parent rotates a quarter turn about z, and the child moves along x.
  const ordered_json parent{{"children", {1}}, {"rotation", {0, 0, h, h}}, {"scale", {2, 2, 2}}};
  const ordered_json child{{"mesh", 0}, {"translation", {1, 0, 0}}};
  const Mat3 turn = turn_matrix({h, 0, 0, h}, 2);
  for (const ordered_json& roots : {ordered_json{0}, ordered_json()})
    CHECK(check_transformed(splats, nodes({parent, child}, roots), turn, {0, 2, 0}, true) < 2e-6);

  const ImportedSplats twice =
      nodes({{{"mesh", 0}}, {{"mesh", 0}, {"rotation", {0, 0, h, h}}, {"scale", {2, 2, 2}}}}, {0, 1});
  REQUIRE(twice.count() == 40);
  CHECK(part_of(twice, 0, 20).positions == splats.positions);
  CHECK(check_transformed(splats, part_of(twice, 20, 20), turn, {0, 0, 0}, true) < 2e-6);

  const auto notes = [&](const ordered_json& list, const ordered_json& roots) {
    return all_of(nodes(list, roots).report.notes);
  };
  const ordered_json moved{{"mesh", 0}, {"translation", {1, 0, 0}}};
  CHECK(notes(ordered_json::array({moved}), {0}).empty());
  CHECK_THAT(notes({moved, {{"mesh", 0}, {"scale", {0, 1, 1}}}}, {0, 1}),
             Contains("1 meshes are not read, because a scale"));
  CHECK_THAT(
      notes({moved, {{"mesh", 0}, {"extensions", {{"KHR_node_visibility", {{"visible", false}}}}}}}, {0, 1}),
      Contains("1 nodes are not visible"));
  CHECK_THAT(notes(ordered_json::array({ordered_json::object()}), {0}), Contains("no node shows the splats"));
  CHECK_THAT(all_of(with([&](ordered_json& j) {
                      j["scenes"].push_back({{"nodes", {0}}});
                      j["meshes"].push_back(j["meshes"][0]);
                    }).report.notes),
             Contains("only scene 0 of 2") && Contains("1 meshes with splats are not used"));
  CHECK_THAT(refusal({parent, {{"children", {0}}, {"mesh", 0}}}, {0}),
             Contains("b.glb: node 0 is listed twice"));
  CHECK_THAT(refusal({parent, child}, {0, 1}), Contains("node 1 is listed twice"));
  CHECK_THAT(refusal(ordered_json::array({parent}), {0}),
             Contains("refers to an object that does not exist"));
  CHECK_THAT(refusal({{{"mesh", 0}, {"rotation", {0, 0, 0, 0}}}}, {0}),
             Contains("node 0 has a transformation that is not finite"));
  CHECK_THAT(
      refusal(
          {{{"mesh", 0}, {"scale", {1, 1, 1}}, {"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}}},
          {0}),
      Contains("node 0 has a matrix and also"));
  CHECK_THAT(refusal({{{"mesh", 0}, {"matrix", {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}}}, {0}),
             Contains("node 0: the last row of the matrix"));

  // Instances: the values of the first two splats serve as translations, and their rotations as rotations.
  const auto instanced = [&](const ordered_json& attributes, std::size_t count) {
    return with([&](ordered_json& j) {
      for (const int accessor : {0, 1}) {
        j["accessors"].push_back(j["accessors"][static_cast<std::size_t>(accessor)]);
        j["accessors"].back()["count"] = count;
      }
      j["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
      j["nodes"][0] = {{"mesh", 0},
                       {"scale", {2, 2, 2}},
                       {"extensions", {{"EXT_mesh_gpu_instancing", {{"attributes", attributes}}}}}};
    });
  };
  std::size_t accessors = 0;
  with([&](ordered_json& j) { accessors = j["accessors"].size(); });
  const ImportedSplats many = instanced({{"TRANSLATION", accessors}, {"ROTATION", accessors + 1}}, 2);
  REQUIRE(many.count() == 40);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto& q = splats.rotations[i];
    const auto& p = splats.positions[i];
    CHECK(check_transformed(splats, part_of(many, 20 * i, 20), turn_matrix({q[0], q[1], q[2], q[3]}, 2),
                            {2 * p[0], 2 * p[1], 2 * p[2]}, true, false) < 2e-6);
  }
  CHECK_THAT(message_of([&] {
               instanced({{"TRANSLATION", accessors}, {"ROTATION", 1}}, 2);
             }),
             Contains("instances of node 0 have different numbers"));
  CHECK_THAT(message_of([&] { instanced(ordered_json::object(), 2); }), Contains("have no TRANSLATION"));
  CHECK_THAT(message_of([&] {
               instanced({{"TRANSLATION", accessors}}, 1'000'000'000);
             }),
             Contains("does not fit into the file"));
}

TEST_CASE("kinds: glTF text reads its numbers from data URIs and from files in its folder only",
          "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(20, 3);
  write_glb(folder / "a.glb", splats);
  const std::string numbers = numbers_of_glb(get(folder / "a.glb"));
  std::filesystem::create_directories(folder / "in/sub");
  const auto with_uri = [&](const std::string& uri) {
    put(folder / "in/a.gltf", gltf_text(splats, [&](ordered_json& j) { j["buffers"][0]["uri"] = uri; }));
    return message_of([&] {
      const ImportedSplats back = read_foreign_splats(folder / "in/a.gltf");
      CHECK(back.positions == splats.positions);
      CHECK(back.sh == splats.sh);
      CHECK(back.report.notes.empty());
    });
  };
  put(folder / "in/plain.gltf", "\xef\xbb\xbf" + gltf_text(splats));
  CHECK(detect_splat_format(folder / "in/plain.gltf").name == "gltf");
  CHECK(read_foreign_splats(folder / "in/plain.gltf").sh == splats.sh);
  put(folder / "in/a.bin", numbers);
  put(folder / "in/sub/a b.bin", numbers + "and more");
  put(folder / "out.bin", numbers);
  CHECK(with_uri("a.bin").empty());
  CHECK(with_uri("sub/a%20b.bin").empty());
  CHECK_THAT(with_uri("../out.bin"), Contains("a.gltf: the file '../out.bin' is not in the same folder"));
  CHECK_THAT(with_uri("%2e%2e/out.bin"), Contains("is not in the same folder"));
  CHECK_THAT(with_uri((folder / "out.bin").string()), Contains("is not in the same folder"));
  std::filesystem::create_symlink(folder / "out.bin", folder / "in/link.bin");
  std::filesystem::create_symlink(folder.path(), folder / "in/up");
  CHECK_THAT(with_uri("link.bin"), Contains("is a link that leads out of the folder"));
  CHECK_THAT(with_uri("up/out.bin"), Contains("is a link that leads out of the folder"));
  std::filesystem::create_symlink(folder / "in/a.bin", folder / "in/inner.bin");
  CHECK(with_uri("inner.bin").empty());
  CHECK_THAT(with_uri("missing.bin"), Contains("missing.bin"));
  CHECK_THAT(with_uri("https://example.org/a.bin"), Contains("at the address 'https://example.org/a.bin'"));
  CHECK_THAT(with_uri("data:,abc"), Contains("not in base64"));
  CHECK_THAT(with_uri("data:x;base64,AA*A"), Contains("character 2 of a data URI"));
  put(folder / "in/a.bin", numbers.substr(0, numbers.size() - 1));
  CHECK_THAT(with_uri("a.bin"), Contains("a.gltf: truncated: buffer 0 has"));
  // A binary file may have some of its numbers in another file. parse_glb() reads no other files.
  put(folder / "in/a.bin", numbers);
  const std::string glb =
      changed_glb(get(folder / "a.glb"), [](ordered_json& j) { j["buffers"][0]["uri"] = "a.bin"; });
  put(folder / "in/b.glb", glb);
  CHECK(read_foreign_splats(folder / "in/b.glb").positions == splats.positions);
  CHECK_THAT(message_of([&] { parse_glb(std::as_bytes(std::span(glb)), "b.glb"); }),
             Contains("b.glb: the file 'a.bin' is not in this file"));
  // A text file that is cut anywhere is an error.
  const std::string text = gltf_text(random_splats(1, 0));
  for (std::size_t size = 0; size < text.size(); size += 7) {
    put(folder / "in/a.gltf", text.substr(0, size));
    CHECK(!message_of([&] { load_splat_model(folder / "in/a.gltf"); }).empty());
  }
}

TEST_CASE("kinds: attributes of early drafts of KHR_gaussian_splatting are read", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(20, 1);
  // COLOR_0 is in a second buffer.
  std::string colours;
  for (std::size_t i = 0; i < 20; ++i)
    for (std::size_t c = 0; c < 4; ++c) {
      const auto v = static_cast<float>(c < 3 ? splats.sh[12 * i + c] * kShC0 + 0.5
                                              : sigmoid_of(splats.opacity_logits[i]));
      colours.append(reinterpret_cast<const char*>(&v), sizeof v);
    }
  const auto with = [&](const std::function<void(ordered_json&)>& change) {
    put(folder / "a.gltf", gltf_text(splats, [&](ordered_json& j) {
          ordered_json& attributes = j["meshes"][0]["primitives"][0]["attributes"];
          attributes.erase("KHR_gaussian_splatting:OPACITY");
          attributes.erase("KHR_gaussian_splatting:SH_DEGREE_0_COEF_0");
          attributes["COLOR_0"] = j["accessors"].size();
          j["accessors"].push_back({{"bufferView", j["bufferViews"].size()},
                                    {"componentType", 5126},
                                    {"count", 20},
                                    {"type", "VEC4"}});
          j["bufferViews"].push_back({{"buffer", 1}, {"byteOffset", 0}, {"byteLength", colours.size()}});
          j["buffers"].push_back({{"byteLength", colours.size()}, {"uri", data_uri(colours)}});
          change(j);
        }));
    return read_foreign_splats(folder / "a.gltf");
  };
  const auto oldest = [](ordered_json& j) {
    ordered_json& attributes = j["meshes"][0]["primitives"][0]["attributes"];
    ordered_json renamed;
    for (const auto& [key, value] : attributes.items())
      renamed[key.starts_with("KHR") ? "_" + key.substr(key.find(':') + 1) : key] = value;
    attributes = renamed;
    j["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"] = ordered_json::object();
  };
  for (const auto& change : {std::function<void(ordered_json&)>([](ordered_json&) {}),
                             std::function<void(ordered_json&)>(oldest)}) {
    const ImportedSplats back = with(change);
    const Differences d = compare(splats, back);
    CHECK(back.positions == splats.positions);
    CHECK(back.sh_degree == 1);
    CHECK(d.rest == 0);
    CHECK(d.dc < 1e-6);
    CHECK(d.opacity < 1e-6);
    CHECK(d.log_scale < 2e-6);
    CHECK_THAT(all_of(back.report.notes),
               Contains("COLOR_0 is the colour or the opacity") && !Contains("not used"));
  }
  CHECK_THAT(all_of(with(oldest).report.notes), Contains("names of an early draft"));
  CHECK_THAT(message_of([&] { with([](ordered_json& j) { j["accessors"].back()["type"] = "VEC3"; }); }),
             Contains("is not of the type VEC4"));
  CHECK_THAT(message_of([&] {
               with([](ordered_json& j) { j["meshes"][0]["primitives"][0]["attributes"].erase("COLOR_0"); });
             }),
             Contains("the attribute KHR_gaussian_splatting:OPACITY is missing"));
  CHECK_THAT(
      message_of([&] {
        with([](ordered_json& j) {
          j["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["quantizedPositionScale"] =
              2;
        });
      }),
      Contains("quantizedPositionScale"));
  CHECK_THAT(message_of([&] {
               with([](ordered_json& j) {
                 j["meshes"][0]["primitives"][0]["extensions"] = {
                     {"KHR_spz_gaussian_splats_compression", {{"bufferView", 0}}}};
               });
             }),
             Contains("the extension KHR_spz_gaussian_splats_compression is not supported"));
}

TEST_CASE("kinds: errors describe files without splats", "[formats]") {
  const TempFolder folder;
  const std::string ply = "ply\nformat binary_little_endian 1.0\nelement vertex 2\n";
  const auto columns = [](std::initializer_list<const char*> names) {
    std::string text;
    for (const char* name : names) text += fmt::format("property float {}\n", name);
    return text;
  };
  const auto text = [](std::string_view plain) {
    return text_of(deflate_gzip(std::as_bytes(std::span(plain))));
  };
  const std::tuple<const char*, std::string, const char*> kinds[] = {
      {"p.ply", ply + columns({"x", "y", "z", "red"}) + "end_header\n" + std::string(32, 0),
       "a point cloud of 2 points, no splats"},
      {"q.ply",
       replaced(ply, "vertex", "point") + columns({"x", "y", "z", "red"}) + "end_header\n" +
           std::string(32, 0),
       "a point cloud of 2 points, no splats"},
      {"m.ply",
       ply + columns({"x", "y", "z"}) +
           "element face 7\nproperty list uchar int vertex_indices\nend_header\n",
       "a mesh with 2 vertices and 7 faces, but no splats"},
      {"s.ply",
       ply +
           columns(
               {"x", "y", "z", "f_offset_0", "f_anchor_feat_0", "opacity", "scale_0", "scale_1", "rot_0"}) +
           "end_header\n",
       "2 anchors of Scaffold-GS, no splats"},
      {"d.zip", zip_of({{"images/", ""}, {"images/a.png", "x"}, {"sparse/0/cameras.bin", "x"}}),
       "a ZIP archive of 3 files"},
      {"d.sog", zip_of({{"a.png", "x"}}), "unpack it first"},
      {"c.pth", zip_of({{"archive/data.pkl", "x"}}), "a PyTorch checkpoint"},
      {"l.sog", zip_of({{"lod-meta.json", "{}"}, {"0_0/meta.json", "{}"}}), "unpack it first"},
      {"p.ply.gz", text("ply\nformat ascii 1.0\n"), "a PLY file compressed with gzip: unpack it first"},
      {"x.gz", text("something else"), "compressed with gzip: unpack it first"},
      {"a.7z", "7z\xbc\xaf and more", "an archive: unpack it first"},
      {"transforms.json", R"({"frames": []})", "cameras of a data folder, no splats"},
      {"gltf.json", R"({"asset": {}, "meshes": []})", "its name must end with .gltf"},
      {"cameras.json", R"([{"id": 0, "img_name": "a", "rotation": [], "fx": 1}])", "3DGS (cameras.json)"},
      {"list.json", "[]", "a JSON file, no splats"},
      {"a.npy", "\x93NUMPY and more", "arrays of NumPy: export the splats as PLY"},
      {"a.npz", zip_of({{"means.npy", "x"}, {"quats.npy", "x"}}),
       "arrays of NumPy: export the splats as PLY"},
      {"colourless.ply", ply_of(random_splats(2, 0), {.without = {"f_dc_0", "f_dc_1", "f_dc_2"}}),
       "splats without colours: property 'f_dc_0'"},
      {"other.json", "{}", "a JSON file, no splats"},
      {"a.las", "LASF and more", "a point cloud, no splats"},
      {"w.ply", "<!DOCTYPE html>", "a web page"},
      {"g.ply", "version https://git-lfs.github.com/spec/v1", "git lfs pull"},
      {"k.ksplat", std::string(4096, '\1'), ".ksplat"},
      {"meta.lcc", R"({"version": "1.1", "splats": [100], "encoding": "COMPRESS"})", "XGRIDS Lixel CyberColor"},
      {"x.rad", "RAD0" + std::string(200, '\0'), "Spark"},
      {"e.ply", "", "an empty file"},
      {"n.bin", "nothing known", "not a splat file: expected"}};
  for (const auto& [name, content, message] : kinds) {
    put(folder / name, content);
    CHECK_THAT(message_of([&] { detect_splat_format(folder / name); }), Contains(name) && Contains(message));
    CHECK_THAT(message_of([&] { load_splat_model(folder / name); }), Contains(message));
  }
  CHECK(describe_file(folder / "n.bin").empty());
  CHECK_THAT(describe_file(folder / "d.zip"), Contains("unpack it first"));
}

TEST_CASE("kinds: a PLY file of nerfstudio with one colour per splat is read", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(1, 0);
  const auto ply = [&](const char* type) {
    std::string file = ply_of(splats, {.extra = {"red"}, .without = {"f_dc_0", "f_dc_1", "f_dc_2"}});
    file.resize(file.size() - sizeof(float));
    return replaced(file, "property float red\n",
                    fmt::format("property {0} red\nproperty {0} green\nproperty {0} blue\n", type));
  };
  put(folder / "a.ply", ply("uchar") + std::string("\xff\x00\x33", 3));
  CHECK(detect_splat_format(folder / "a.ply").name == "3dgs");
  const ImportedSplats back = read_foreign_splats(folder / "a.ply");
  CHECK(back.report.notes.empty());
  CHECK(back.positions == splats.positions);
  CHECK(back.log_scales == splats.log_scales);
  const double colours[] = {1, 0, 0.2};
  for (std::size_t c = 0; c < 3; ++c) CHECK(kShC0 * back.sh[c] + 0.5 == Approx(colours[c]).margin(1e-6));
  put(folder / "b.ply", ply("float") + std::string(12, '\0'));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.ply"); }),
             Contains("b.ply: property 'red' must have the type uchar"));
}

TEST_CASE("kinds: isotropic splats are spheres, and quantised columns are refused", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(20, 0);
  put(folder / "a.ply", ply_of(splats, {.without = {"scale_1", "scale_2"}}));
  const ImportedSplats back = read_foreign_splats(folder / "a.ply");
  REQUIRE(back.count() == 20);
  CHECK(back.sh == splats.sh);
  for (std::size_t i = 0; i < 20; ++i)
    for (const float scale : back.log_scales[i]) CHECK(scale == splats.log_scales[i][0]);
  CHECK(all_of(back.report.notes) == "the file has only scale_0: its splats are spheres");
  put(folder / "c.ply", ply_of(splats, {.without = {"scale_1"}}));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "c.ply"); }), Contains("'scale_1' is missing"));
  for (const char* name : {"scale_1", "rot_2", "opacity", "f_dc_0"}) {
    put(folder / "b.ply",
        replaced(ply_of(splats), fmt::format("float {}\n", name), fmt::format("int {}\n", name)));
    CHECK_THAT(
        message_of([&] { read_foreign_splats(folder / "b.ply"); }),
        Contains(fmt::format("b.ply: property '{}' has an integer type, so the file is quantised", name)));
  }
}

TEST_CASE("kinds: a compressed PLY file of gsplat has an element sh without properties", "[formats]") {
  const TempFolder folder;
  const std::string file = compressed_ply("", "");
  put(folder / "a.ply", replaced(file, "end_header\n", "element sh 1\nend_header\n"));
  const ImportedSplats splats = read_foreign_splats(folder / "a.ply");
  CHECK(splats.count() == 1);
  CHECK(splats.sh_degree == 0);
  CHECK(splats.report.notes.empty());
  put(folder / "b.ply", replaced(file, "end_header\n", "element sh 2\nend_header\n"));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.ply"); }),
             Contains("the element sh has 2 rows"));
  // In ASCII files, such rows have no lines.
  const std::string ascii = ply_of(random_splats(3, 0), {.ascii = true});
  put(folder / "c.ply", replaced(ascii, "end_header\n", "element surplus 2\nend_header\n"));
  CHECK(read_foreign_splats(folder / "c.ply").count() == 3);
}

TEST_CASE("kinds: an index beyond the end of a SOG codebook is an error", "[formats]") {
  const TempFolder folder;
  write_sog(folder / "a.sog", random_splats(40, 1));
  const auto message = [&](const char* group, std::size_t entries) {
    auto members = members_of(folder / "a.sog");
    for (auto& [name, text] : members)
      if (name == "meta.json") {
        ordered_json meta = ordered_json::parse(text);
        std::vector<double> book = meta[group]["codebook"];
        book.resize(entries);
        meta[group]["codebook"] = book;
        text = meta.dump();
      }
    put(folder / "b.sog", zip_of(members));
    return message_of([&] { read_foreign_splats(folder / "b.sog"); });
  };
  for (const char* group : {"scales", "sh0", "shN"})
    CHECK_THAT(message(group, 3), Contains(fmt::format("b.sog: meta.json: {}.codebook has 3 entries, but the "
                                                       "image refers to entry",
                                                       group)));
  CHECK(message("sh0", 256).empty());
}

TEST_CASE("kinds: a glTF file that needs other extensions or lacks values is refused with one line",
          "[formats]") {
  const TempFolder folder;
  write_glb(folder / "a.glb", random_splats(10, 0));
  const auto message = [&](const std::function<void(ordered_json&)>& change) {
    put(folder / "b.glb", changed_glb(get(folder / "a.glb"), change));
    return message_of([&] { read_foreign_splats(folder / "b.glb"); });
  };
  const auto primitive = [](ordered_json& j) -> ordered_json& { return j["meshes"][0]["primitives"][0]; };
  CHECK_THAT(message([&](ordered_json& j) {
               primitive(j)["extensions"]["KHR_gaussian_splatting"]["extensions"] = {
                   {"KHR_gaussian_splatting_compression_spz_2", {{"bufferView", 0}}}};
             }),
             Contains("the extension KHR_gaussian_splatting_compression_spz_2 is not supported: export"));
  CHECK_THAT(message([](ordered_json& j) {
               j["extensionsRequired"] = {"KHR_gaussian_splatting", "KHR_draco_mesh_compression"};
             }),
             Contains("b.glb: the extension KHR_draco_mesh_compression is not supported"));
  CHECK(message([](ordered_json& j) {
          j["extensionsRequired"] = {"KHR_gaussian_splatting", "KHR_mesh_quantization"};
        }).empty());
  CHECK(message([&](ordered_json& j) { primitive(j)["attributes"].erase("POSITION"); }) ==
        (folder / "b.glb").string() + ": the attribute POSITION is missing");
  CHECK_THAT(message([](ordered_json& j) { j["accessors"][2].erase("bufferView"); }),
             Contains("b.glb: accessor 2 has no bufferView, so its values are missing"));
}

TEST_CASE("kinds: a file without any valid splat is an error", "[formats]") {
  const TempFolder folder;
  ImportedSplats splats = random_splats(12, 0);
  for (auto& q : splats.rotations) q = {0, 0, 0, 0};
  put(folder / "a.ply", ply_of(splats));
  for (const auto& read : {std::function<void()>([&] { read_foreign_splats(folder / "a.ply"); }),
                           std::function<void()>([&] { load_splat_model(folder / "a.ply"); })})
    CHECK_THAT(message_of(read),
               Contains("none of its 12 splats can be rendered: the rotation is not a quaternion"));
}

TEST_CASE("kinds: files without splats are neither written nor read", "[formats]") {
  const TempFolder folder;
  ImportedSplats none = random_splats(0, 1);
  for (const SplatFormat& format : splat_formats()) {
    INFO(format.name);
    none.kernel = format.holds == SplatFormat::Holds::beta ? SpatialKernel::beta : SpatialKernel::gaussian;
    const std::filesystem::path path = folder / fmt::format("none{}", format.extension);
    if (format.write && format.name != "usdc")  // OpenUSD converts the text that the writer of usda writes
      CHECK(message_of([&] { write_foreign_splats(format, path, none); }) ==
            path.string() + ": there are no splats to write");
    if (format.write_series && format.name != "usdc")
      CHECK_THAT(message_of([&] { format.write_series(path, SplatSeries({none})); }), Contains("no splats"));
    CHECK(!std::filesystem::exists(path));
  }
  CHECK_THAT(message_of([&] { write_splat_ply(folder / "none.ply", SplatModel(7, 0)); }),
             Contains("none.ply: there are no splats to write"));
  CHECK(!std::filesystem::exists(folder / "none.ply"));

  // Files of which only the number of splats was changed.
  const ImportedSplats one = random_splats(1, 0);
  const auto refusal = [&](const char* name, const std::string& file) {
    put(folder / name, file);
    return message_of([&] { load_splat_model(folder / name); });
  };
  const auto ply_header = [&](const std::string& file) {
    return replaced(file.substr(0, file.find("end_header\n") + 11), "vertex 1", "vertex 0");
  };
  const auto empty = Contains(": the file has no splats");
  CHECK_THAT(refusal("a.ply", ply_header(ply_of(one))), empty);
  CHECK_THAT(refusal("b.ply", ply_header(ply_of(one, {.ascii = true}))), empty);
  CHECK_THAT(refusal("c.ply", replaced(ply_header(compressed_ply("", "")), "chunk 1", "chunk 0")), empty);
  write_splat_ply(folder / "d.ply", SplatModel(7, 1));
  CHECK_THAT(refusal("d.ply", ply_header(get(folder / "d.ply"))), empty);
  CHECK_THAT(refusal("a.gltf", gltf_text(one,
                                         [](ordered_json& j) {
                                           for (ordered_json& accessor : j["accessors"])
                                             accessor["count"] = 0;
                                         })),
             empty);
  CHECK_THAT(
      refusal("a.usda", "#usda 1.0\ndef ParticleField3DGaussianSplat \"S\" { point3f[] positions = [] }\n"),
      empty);
  write_spz(folder / "a.spz", one);
  const std::string packed = get(folder / "a.spz");
  std::vector<std::byte> plain = inflate_gzip(std::as_bytes(std::span(packed)), 1 << 16, "test");
  plain.resize(16);
  plain[8] = std::byte{0};
  CHECK_THAT(refusal("a.spz", text_of(deflate_gzip(plain))), empty);
  CHECK_THAT(refusal("a.splat", ""), Contains("an empty file"));
}

TEST_CASE("kinds: notes shorten lists of numbered names", "[formats]") {
  CHECK(list_names({"motion_0", "motion_1", "motion_2", "t", "omega_3", "omega_4", "a_1", "a_3", "7"}) ==
        "motion_0 to motion_2, t, omega_3, omega_4, a_1, a_3, 7");
}

// There must be a test file with an unused part for every row of the table of formats.
TEST_CASE("notes: every reader reports the parts of a file that it does not use", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(1, 0);
  // Adds a column after the other columns of the only row.
  const auto with_column = [&](const std::filesystem::path& path) {
    put(path,
        replaced(get(path), "end_header\n", "property float surplus\nend_header\n") + std::string(4, '\0'));
  };
  using Make = std::function<void(const std::filesystem::path&)>;
  const std::multimap<std::string_view, Make> surplus{
      {"ubs",
       [&](const auto& path) {
         write_splat_ply(path, exact_model(splats));
         with_column(path);
       }},
      {"ubs",
       [&](const auto& path) {
         write_splat_ply(path, SplatModel(7, 1));
         put(path, replaced(get(path), "end_header\n", "element surplus 1\nproperty float a\nend_header\n") +
                       std::string(4, '\0'));
       }},
      {"compressed", [&](const auto& path) { put(path, compressed_ply("", "property float surplus\n")); }},
      {"3dgs",
       [&](const auto& path) {
         write_gaussian_ply(path, splats);
         with_column(path);
       }},
      {"3dgs",
       [&](const auto& path) {
         put(path,
             replaced(ply_of(splats), "end_header\n", "element surplus 1\nproperty float a\nend_header\n") +
                 std::string(4, '\0'));
       }},
      {"dbs",
       [&](const auto& path) {
         ImportedSplats beta = splats;
         beta.kernel = SpatialKernel::beta;
         beta.betas = {0.0f};
         write_gaussian_ply(path, beta);
         with_column(path);
       }},
      {"spz",
       [&](const auto& path) {
         write_spz(path, splats);
         const std::string packed = get(path);
         std::string plain = text_of(inflate_gzip(std::as_bytes(std::span(packed)), 1 << 16, "test"));
         plain[14] = 0x40;  // an unknown flag; the note contains its number
         put(path, plain);
       }},
      {"sog",
       [&](const auto& path) {
         write_sog(path, splats);
         auto members = members_of(path);
         members.emplace_back("surplus.bin", "x");
         put(path, zip_of(members));
       }},
      {"sog",
       [&](const auto& path) {
         write_sog(path, splats);
         auto members = members_of(path);
         for (auto& [name, text] : members)
           if (name == "meta.json") text = replaced(text, "{\"version\"", "{\"surplus\":1,\"version\"");
         put(path, zip_of(members));
       }},
      {"streamed-sog",
       [&](const auto& path) {
         put_sog_folder(folder / "part", splats);
         put(folder / "part/meta.json",
             replaced(get(folder / "part/meta.json"), "{\"version\"", "{\"surplus\":1,\"version\""));
         put(path, R"({"filenames": ["part/meta.json"],
                       "tree": {"lods": {"0": {"file": 0, "offset": 0, "count": 1}}}})");
       }},
      {"glb",
       [&](const auto& path) {
         write_glb(path, splats);
         put(path, changed_glb(get(path), [](ordered_json& document) {
               document["meshes"][0]["primitives"][0]["attributes"]["_surplus"] = 1;
             }));
       }},
      {"glb",
       [&](const auto& path) {
         write_glb(path, splats);
         put(path, changed_glb(get(path), [](ordered_json& document) {
               document["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", 0}}}});
             }));
       }},
      {"gltf",
       [&](const auto& path) {
         put(path, gltf_text(splats, [](ordered_json& document) {
               document["meshes"][0]["primitives"][0]["attributes"]["_surplus"] = 1;
             }));
       }},
      {"usda",
       [&](const auto& path) {
         write_usda(path, splats);
         put(path, replaced(get(path), "    point3f[]", "    float surplus = 1\n    point3f[]"));
       }},
      {"usda",
       [&](const auto& path) {
         write_usda(path, splats);
         put(path, get(path) + "def Mesh \"surplus\" {}\n");
       }},
      // A .splat file has no unused parts, because all 32 bytes of a record are used. So this row tests that
      // dropped records are reported.
      {"splat", [&](const auto& path) {
         write_splat32(path, random_splats(2, 0));
         std::string bytes = get(path);
         bytes.replace(0, 4, "\xff\xff\xff\xff");  // NaN
         put(path, bytes);
       }}};
  const std::map<std::string_view, const char*> words{{"spz", "flags 0x40"},
                                                      {"splat", "1 dropped: the position is not finite"}};
  for (const SplatFormat& format : splat_formats()) {
    INFO(format.name);
    // OpenUSD converts the binary form to text, which the same reader reads (tests/data/usd_test.py).
    if (format.name == "usdc") continue;
    REQUIRE(surplus.contains(format.name));
    const auto [begin, end] = surplus.equal_range(format.name);
    for (auto row = begin; row != end; ++row) {
      const std::filesystem::path path = folder / fmt::format("x{}", format.extension);
      row->second(path);
      REQUIRE(detect_splat_format(path).name == format.name);
      const std::string remarks = remarks_of(path);
      if (format.name == "glb" && contains(remarks, "primitives")) {
        CHECK_THAT(remarks, Contains("1 primitives without splats are not used"));
        continue;
      }
      if (format.name == "usda" && contains(remarks, "prims")) {
        CHECK_THAT(remarks, Contains("1 prims without splats are not used"));
        continue;
      }
      CHECK_THAT(remarks, Contains(words.contains(format.name) ? words.at(format.name) : "surplus"));
    }
  }
}

TEST_CASE("notes: unused columns of known methods are explained", "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(3, 0);
  PlyKind motion;
  motion.extra = {"trbf_center", "trbf_scale"};
  for (int k = 0; k < 9; ++k) motion.extra.push_back(fmt::format("motion_{}", k));
  put(folder / "stg.ply", ply_of(splats, motion));
  CHECK_THAT(remarks_of(folder / "stg.ply"),
             Contains("trbf_center, trbf_scale, motion_0 to motion_8") && Contains("SpacetimeGaussians"));
  put(folder / "mip.ply", ply_of(splats, {.extra = {"filter_3D"}}));
  CHECK_THAT(remarks_of(folder / "mip.ply"), Contains("not used: filter_3D") && Contains("Mip-Splatting"));
}
