// SPDX-License-Identifier: Apache-2.0
// Implements the fuzz targets for splat files, data sets, files of network weights, headers of images, and
// the detection of file types. targets_media.cpp contains the targets for images and videos, and
// targets_run.cpp contains those for files of runs.
#include "tests/fuzz/targets.hpp"

#include <cstring>

#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/dataset/blender.hpp"
#include "host/dataset/colmap.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/image_info.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/npy.hpp"
#include "host/dataset/packed.hpp"
#include "host/dataset/wide_image_file.hpp"
#include "host/dataset/world_points.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/gaussian_model.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/splat_file.hpp"
#include "host/formats/splat_series.hpp"
#include "host/formats/ubsz.hpp"
#include "host/formats/zip.hpp"
#include "host/pipeline/safetensors.hpp"
#include "host/scene/initialise.hpp"
#include "tests/fuzz/files.hpp"

namespace ubs::fuzz {
namespace {

constexpr std::size_t kWholeMember = SIZE_MAX;  // our own archives need no limit

ImportedSplats few_splats(int degree) {
  ImportedSplats s;
  s.sh_degree = degree;
  s.resize(3);
  for (std::size_t i = 0; i < 3; ++i) {
    s.rotations[i] = {1, 0.1f, 0.2f, static_cast<float>(i)};
    s.positions[i] = {static_cast<float>(i), 1, 2};
    s.log_scales[i] = {-2, -3, -4};
  }
  return s;
}

void import_all(const ImportedSplats& splats) {
  const SplatModel model = exact_model(splats);
  if (is_gaussian_model(model)) to_imported_splats(model);
}

void run_ply(Data d) {
  const fs::path path = put("x.ply", d);
  expect_error_only([&] { read_splat_ply(path); });
  expect_error_only([&] { read_world_points(path); });
  expect_error_only([&] { import_all(read_gaussian_ply(path)); });
  expect_error_only([&] { import_all(read_compressed_ply(path)); });
}
std::string compressed_seed() {
  std::string header = "ply\nformat binary_little_endian 1.0\nelement chunk 1\n";
  for (const char* bound : {"min_", "max_"})
    for (const char* axis : {"x", "y", "z", "scale_x", "scale_y", "scale_z", "r", "g", "b"})
      header += fmt::format("property float {}{}\n", bound, axis);
  header += "element vertex 2\n";
  for (const char* word : {"position", "rotation", "scale", "color"})
    header += fmt::format("property uint packed_{}\n", word);
  header += "element sh 2\n";
  for (int k = 0; k < 9; ++k) header += fmt::format("property uchar f_rest_{}\n", k);
  return header + "end_header\n" + std::string(18 * 4 + 32 + 18, '\x3f');
}
std::vector<std::string> seed_ply() {
  std::vector<std::string> seeds;
  for (const int dim : {3, 6}) {
    write_splat_ply(folder() / "s.ply", initialise_random(dim, 3, 1));
    seeds.push_back(get(folder() / "s.ply"));
  }
  for (const int degree : {0, 1}) {
    write_gaussian_ply(folder() / "s.ply", few_splats(degree));
    seeds.push_back(get(folder() / "s.ply"));
  }
  seeds.push_back(compressed_seed());
  seeds.push_back(
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty double z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 4 5 6\n1 2 3 4 5 "
      "6\n");
  return seeds;
}

// The input is one byte, followed by a file. If the first byte is odd, the function replaces the checksum of
// the header by the correct one, so that the code that runs after the checksum test is tested too.
void run_ubsz(Data d) {
  if (d.empty()) return;
  std::vector<std::uint8_t> file(d.begin() + 1, d.end());
  if (d[0] % 2 == 1 && file.size() >= 16) {
    std::uint32_t size = 0;
    std::memcpy(&size, file.data() + 8, 4);
    if (size > file.size() - 16) return;
    const std::uint32_t crc = crc32(std::as_bytes(std::span(file).subspan(16, size)));
    std::memcpy(file.data() + 12, &crc, 4);
  }
  expect_error_only([&] { unpack_ubsz(std::as_bytes(std::span(file)), "fuzz"); });
}
std::vector<std::string> seed_ubsz() {
  std::vector<std::string> seeds;
  for (const int dim : {3, 6}) {
    const SplatModel model = initialise_random(dim, 5, 1);
    const UbszSteps steps{std::vector<double>(static_cast<std::size_t>(model.layout().count), 0.01),
                          {0, 1, 2, 5, 0}};
    const UbszLevel level{model, {steps}, 30};
    for (const auto& packed : {pack_ubsz(model, {}), pack_ubsz(model, {}, std::span(&steps, 1)),
                               pack_ubsz_levels(std::vector{level, level}, {}).bytes})
      for (const char first : {'\0', '\1'})
        seeds.push_back(first + std::string(reinterpret_cast<const char*>(packed.data()), packed.size()));
  }
  return seeds;
}

// If the first byte is even, the rest of the input is the content of an SPZ file without gzip. Otherwise, it
// is a complete file, which is compressed with gzip or has version 4.
void run_spz(Data d) {
  if (d.empty()) return;
  if (d[0] % 2 == 0) {
    expect_error_only([&] { import_all(parse_spz(std::as_bytes(d.subspan(1)), "fuzz")); });
  } else {
    const fs::path path = put("x.spz", d.subspan(1));
    expect_error_only([&] { import_all(read_spz(path)); });
  }
}
void run_glb(Data d) {
  expect_error_only([&] { import_all(parse_glb(std::as_bytes(d), "fuzz")); });
}
std::vector<std::string> seed_glb() {
  std::vector<std::string> seeds;
  for (const int degree : {0, 2}) {
    write_glb(folder() / "s.glb", few_splats(degree));
    seeds.push_back(get(folder() / "s.glb"));
  }
  return seeds;
}

void run_usda(Data d) {
  const std::string text(reinterpret_cast<const char*>(d.data()), d.size());
  expect_error_only([&] { import_all(parse_usda(text, "fuzz")); });
  expect_error_only([&] { import_all(parse_usda(text, "fuzz", 0.6)); });
}
std::vector<std::string> seed_usda() {
  std::vector<std::string> seeds;
  for (const int degree : {0, 2}) {
    std::vector<ImportedSplats> moments(2, few_splats(degree));
    for (ImportedSplats& splats : moments) splats.offset = {1, 2, 3};
    moments[1].positions[0][0] = 7;
    write_usda_series(folder() / "s.usda", SplatSeries(moments));
    seeds.push_back(get(folder() / "s.usda"));
  }
  seeds.push_back(
      "#usda 1.0\n( doc = \"x\"\n upAxis = \"Z\" )\ndef Xform \"X\" ( prepend references = @a@</b> ) {\n"
      "def ParticleField3DGaussianSplat \"S\" { point3h[] positionsh = [(1,2,3)]\n quatd xformOp:orient = "
      "(1,0,0,0)\n uniform token[] xformOpOrder = [\"xformOp:orient\"] rel a = </b> } }\n");
  return seeds;
}

// The input of run_sog() is one byte, followed by an archive if this byte is even. If it is odd, the members
// of the archive follow as blocks, in the order of kSogMembers, and run_sog() creates an archive with correct
// checksums from them.
constexpr const char* kSogMembers[] = {"meta.json",  "means_l.webp", "means_u.webp",       "scales.webp",
                                       "quats.webp", "sh0.webp",     "shN_centroids.webp", "shN_labels.webp"};
void run_sog(Data d) {
  if (d.empty()) return;
  const bool members = d[0] % 2 == 1;
  d = d.subspan(1);
  std::vector<std::byte> file;
  if (members) {
    ZipWriter zip;
    for (const char* name : kSogMembers) zip.add(name, std::as_bytes(take_block(d)));
    file = zip.finish();
  } else {
    file.assign(std::as_bytes(d).begin(), std::as_bytes(d).end());
  }
  expect_error_only([&] { import_all(parse_sog(file, "fuzz")); });
}
std::vector<std::string> seed_sog() {
  std::vector<std::string> seeds;
  for (const int degree : {0, 1}) {
    write_sog(folder() / "s.sog", few_splats(degree));
    const std::string file = get(folder() / "s.sog");
    seeds.push_back('\0' + file);
    const ZipReader zip(std::as_bytes(std::span(file)), "seed");
    std::string members(1, '\1');
    for (const char* name : kSogMembers) {
      if (degree == 0 && std::string_view(name).starts_with("shN")) continue;
      const auto bytes = zip.get(name, kWholeMember);
      members += block({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    }
    seeds.push_back(members);
  }
  return seeds;
}

// The input is one byte, followed by the lod-meta.json of a streamed SOG if this byte is even, or by the
// meta.json of one of its folders if it is odd. The images are intact, because run_sog() tests damaged
// images.
void run_streamed_sog(Data d) {
  if (d.empty()) return;
  static const std::vector<std::pair<std::string, std::vector<std::byte>>> members = [] {
    write_sog(folder() / "s.sog", few_splats(1));
    const std::string file = get(folder() / "s.sog");
    const ZipReader zip(std::as_bytes(std::span(file)), "seed");
    std::vector<std::pair<std::string, std::vector<std::byte>>> all;
    for (const std::string& name : zip.names()) all.emplace_back(name, zip.get(name, kWholeMember));
    return all;
  }();
  fs::create_directories(folder() / "part");
  for (const auto& [name, bytes] : members)
    put("part/" + name, {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
  const bool meta = d[0] % 2 == 1;
  const fs::path damaged = put(meta ? "part/meta.json" : "lod-meta.json", d.subspan(1));
  expect_error_only([&] { import_all(meta ? read_sog(damaged) : read_streamed_sog(damaged)); });
}
std::vector<std::string> seed_streamed_sog() {
  write_sog(folder() / "s.sog", few_splats(1));
  const std::string file = get(folder() / "s.sog");
  const auto meta = ZipReader(std::as_bytes(std::span(file)), "seed").get("meta.json", kWholeMember);
  return {std::string(1, '\0') +
              R"({"lodLevels": 2, "filenames": ["part/meta.json"], "environment": "part/meta.json",
              "tree": {"children": [{"lods": {"0": {"file": 0, "offset": 0, "count": 2}}},
                                    {"lods": {"1": {"file": 0, "offset": 2, "count": 1}}}]}})",
          '\1' + std::string(reinterpret_cast<const char*>(meta.data()), meta.size())};
}

std::vector<std::string> seed_spz() {
  std::vector<std::string> seeds;
  for (const int degree : {0, 1, 3}) {
    write_spz(folder() / "s.spz", few_splats(degree));
    const std::string file = get(folder() / "s.spz");
    const auto plain = inflate_gzip(std::as_bytes(std::span(file)), 100000, "seed");
    seeds.push_back("\x01" + file);
    std::string payload(reinterpret_cast<const char*>(plain.data()), plain.size());
    seeds.push_back(std::string(1, '\0') + payload);
    payload[4] = 2;
    seeds.push_back(std::string(1, '\0') + payload);
    payload[4] = 4;
    payload[15] = 5;
    seeds.push_back("\x01" + payload + std::string(100, '\x20'));
  }
  return seeds;
}

void run_splat32(Data d) {
  const fs::path path = put("x.splat", d);
  expect_error_only([&] { import_all(read_splat32(path)); });
}
std::vector<std::string> seed_splat32() {
  write_splat32(folder() / "s.splat", few_splats(0));
  return {get(folder() / "s.splat")};
}

// The input has three blocks, each preceded by its length: cameras, images and points.
void run_colmap(Data d, const char* extension) {
  for (const char* name : {"cameras", "images", "points3D"})
    put(fmt::format("sparse/{}.{}", name, extension), take_block(d));
  expect_error_only([] { load_dataset(folder(), {.read = {.layout = "colmap"}, .load_images = false}); });
  for (const char* name : {"cameras", "images", "points3D"})
    fs::remove(folder() / "sparse" / fmt::format("{}.{}", name, extension));
}
void run_colmap_binary(Data d) { run_colmap(d, "bin"); }
void run_colmap_text(Data d) { run_colmap(d, "txt"); }
std::vector<std::string> seed_colmap_text() {
  const std::string images = "1 1 0 0 0 0 0 0 1 a.png\n\n2 0.5 0.5 0.5 0.5 1 2 3 1 b.png\n1 2 3\n";
  std::vector<std::string> seeds;
  for (const char* camera :
       {"1 PINHOLE 640 480 500 500 320 240\n", "1 OPENCV 64 48 50 50 32 24 0.1 0.01 0 0\n",
        "1 FOV 64 48 50 50 32 24 0.5\n", "1 OPENCV_FISHEYE 64 48 50 50 32 24 0.1 0.01 0 0\n"})
    seeds.push_back(block(camera) + block(images) + block("1 0 0 0 1 2 3 0.5 1 2\n"));
  return seeds;
}
std::vector<std::string> seed_colmap_binary() {
  std::vector<std::string> seeds;
  const int counts[] = {3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12, 16, 4, 5, 3, 4, 6, 2};
  for (int model = 0; model < 18; ++model) {
    std::string cameras, images, points;
    add<std::uint64_t>(cameras, 1), add<std::uint32_t>(cameras, 1), add<std::int32_t>(cameras, model);
    add<std::uint64_t>(cameras, 64), add<std::uint64_t>(cameras, 48);
    for (int i = 0; i < counts[model]; ++i) add(cameras, i < 4 ? 50.0 : 0.01);
    add<std::uint64_t>(images, 1), add<std::uint32_t>(images, 1);
    for (const double v : {1., 0., 0., 0., 0., 0., 0.}) add(images, v);
    add<std::uint32_t>(images, 1);
    images += std::string("a.png\0", 6);
    add<std::uint64_t>(images, 0);
    add<std::uint64_t>(points, 1), add<std::uint64_t>(points, 1);
    for (int i = 0; i < 3; ++i) add(points, 1.0);
    points += "rgb";
    add(points, 0.5), add<std::uint64_t>(points, 0);
    seeds.push_back(block(cameras) + block(images) + block(points));
  }
  return seeds;
}

void run_json(Data d) {
  put("transforms.json", d);
  put("transforms_train.json", d);
  expect_error_only([] { load_dataset(folder(), {.read = {.layout = "nerfstudio"}, .load_images = false}); });
  expect_error_only([] { load_dataset(folder(), {.read = {.layout = "blender"}, .load_images = false}); });
}
std::vector<std::string> seed_json() {
  return {
      R"({"camera_angle_x":0.9,"w":8,"h":6,"k1":0.1,"p1":0.01,"frames":[{"file_path":"a","time":0.5,"query":[1],)"
      R"("transform_matrix":[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]},{"file_path":"b.png","fl_x":9,"cx":4,)"
      R"("query":[2],"time":1,"transform_matrix":[[1,0,0,0],[0,0,-1,-4],[0,1,0,0]]}]})",
      R"({"camera_model":"OPENCV_FISHEYE","fl_x":9,"fl_y":9,"w":8,"h":6,"train_filenames":["a"],)"
      R"("ply_file_path":"p.ply","frames":[{"file_path":"a","transform_matrix":[[1,0,0,1],[0,1,0,2],[0,0,1,3]]}]})"};
}

// The first byte selects the layout, and the other bytes are its file.
void run_cameras(Data d) {
  constexpr std::pair<const char*, const char*> kFiles[] = {
      {"metashape", "c/m.xml"},      {"realitycapture", "c/r.csv"},
      {"realitycapture", "c/a.xmp"}, {"opensfm", "c/reconstruction.json"},
      {"bundler", "c/bundle.out"},   {"polycam", "c/keyframes/cameras/a.json"},
      {"record3d", "c/metadata"}};
  if (d.empty()) return;
  const auto& [layout, file] = kFiles[d[0] % std::size(kFiles)];
  fs::remove_all(folder() / "c");
  fs::create_directories((folder() / file).parent_path());
  const std::string list = "a.png\n";
  put("c/list.txt", {reinterpret_cast<const std::uint8_t*>(list.data()), list.size()});
  put(file, d.subspan(1));
  const std::string name = layout;
  expect_error_only([&] { load_dataset(folder() / "c", {.read = {.layout = name}, .load_images = false}); });
  expect_error_only([] { detect_layout(folder() / "c"); });
}
std::vector<std::string> seed_cameras() {
  const std::string identity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
  return {
      std::string(1, '\0') +
          R"(<document><chunk><sensors><sensor id="0"><resolution width="8" height="6"/><calibration><f>9</f>)"
          R"(<k1>0.1</k1></calibration></sensor></sensors><cameras><group><camera label="a" sensor_id="0">)"
          "<transform>" +
          identity +
          "</transform></camera></group></cameras><transform><scale>2</scale>"
          "</transform></chunk></document>",
      "\1#name,x,y,alt,heading,pitch,roll,f,px,k1\na.png,1,2,3,10,20,30,35,0,0.1\n",
      "\2<x><d xcr:Position=\"1 2 3\" xcr:FocalLength35mm=\"35\"><xcr:Rotation>1 0 0 0 1 0 0 0 "
      "1</xcr:Rotation>"
      "<xcr:DistortionCoeficients>0 0 0</xcr:DistortionCoeficients></d></x>",
      "\3"
      R"([{"cameras":{"c":{"projection_type":"brown","width":8,"height":6,"focal_x":1}},"shots":{"a":)"
      R"({"camera":"c","rotation":[0,0,1],"translation":[0,0,0]}},"points":{"1":{"coordinates":[1,2,3]}}}])",
      "\4# Bundle file v0.3\n1 1\n9 0.1 0\n1 0 0\n0 1 0\n0 0 1\n0 0 0\n1 2 3\n4 5 6\n1 0 0 1 1\n",
      "\5"
      R"({"t_00":1,"t_01":0,"t_02":0,"t_03":0,"t_10":0,"t_11":1,"t_12":0,"t_13":0,"t_20":0,"t_21":0,)"
      R"("t_22":1,"t_23":0,"fx":9,"fy":9,"cx":4,"cy":3,"width":8,"height":6})",
      "\6"
      R"({"w":8,"h":6,"K":[9,0,0,0,9,0,4,3,1],"poses":[[0,0,0,1,1,2,3]]})"};
}

void run_npy(Data d) {
  const fs::path path = put("poses_bounds.npy", d);
  expect_error_only([&] { read_npy(path); });
  expect_error_only([] { load_dataset(folder(), {.read = {.layout = "llff"}, .load_images = false}); });
}
std::vector<std::string> seed_npy() {
  std::vector<float> row{0, 1, 0, 0, 96, -1, 0, 0, 0, 128, 0, 0, 1, 0, 100, 2, 9};
  write_npy(folder() / "s.npy", std::vector<std::size_t>{1, 17}, row);
  return {get(folder() / "s.npy")};
}

void run_safetensors(Data d) {
  const fs::path path = put("x.safetensors", d);
  expect_error_only([&] { read_safetensors(path); });
}
std::vector<std::string> seed_safetensors() {
  const std::string header =
      R"({"__metadata__":{"format":"pt"},"a.weight":{"dtype":"F32","shape":[2,1,1],"data_offsets":[0,8]},)"
      R"("b":{"dtype":"F32","shape":[1],"data_offsets":[8,12]}})";
  std::string file;
  add<std::uint64_t>(file, header.size());
  file += header;
  for (const float value : {1.0f, 2.0f, 3.0f}) add(file, value);
  return {file};
}

// The input consists of the version (1 byte), the header as a block, and the blocks of the file. This
// function creates the preamble, because a fuzzer cannot guess the checksum of the header.
void run_packed(Data d) {
  if (d.empty()) return;
  const std::uint32_t version = d[0];
  d = d.subspan(1);
  const Data header = take_block(d);
  std::string file("UBSDATA\x1a", 8);
  add<std::uint32_t>(file, version), add<std::uint32_t>(file, crc32(std::as_bytes(header)));
  add<std::uint64_t>(file, header.size());
  for (const Data part : {header, d}) file.append(reinterpret_cast<const char*>(part.data()), part.size());
  const fs::path path = put("x.ubsd", {reinterpret_cast<const std::uint8_t*>(file.data()), file.size()});
  expect_error_only([&] { load_dataset(path, {.read = {.layout = "packed"}}); });
}
std::vector<std::string> seed_packed() {
  std::vector<std::string> seeds;
  struct WidePixels : ImageSource {
    Image8 load() const override {
      return {8, 8, std::vector<std::uint8_t>(192, 90), std::vector<std::uint8_t>(64, 255)};
    }
  };
  for (const int version : {1, 2, 3}) {
    View view{"a", {}, {2, 1, std::vector<std::uint8_t>(6, 9), {}}, nullptr};
    view.camera.width = 2, view.camera.height = 1;
    if (version == 2) view.image.mask = {0, 255};
    if (version == 3) {
      view.part_of = "wide";
      view.wide = std::make_shared<StoredWideImage>(wide_lens("fisheye:200", 8, 8), "wide",
                                                    std::make_shared<WidePixels>());
    }
    PackedData data{.splits = {{"train", {view}}},
                    .points = PointCloud{{{1, 2, 3}}, {{4, 5, 6}}},
                    .depth_bounds = {{{1, 2}}}};
    write_packed(folder() / "s.ubsd", data);
    const std::string file = get(folder() / "s.ubsd");
    std::uint64_t length = 0;
    std::memcpy(&length, file.data() + 16, sizeof length);
    seeds.push_back(file[8] + block(file.substr(24, length)) + file.substr(24 + length));
  }
  return seeds;
}

// Tests how the type of a file is recognised, and how messages name it. The first byte chooses the extension.
constexpr const char* kExtensions[] = {".ply", ".json", ".zip", ".spz", ".gltf", ".splat"};
void run_file_kind(Data d) {
  if (d.empty()) return;
  const fs::path path = put(std::string("kind") + kExtensions[d[0] % std::size(kExtensions)], d.subspan(1));
  expect_error_only([&] { describe_file(path); });
  expect_error_only([&] { detect_splat_format(path); });
  expect_error_only([&] { find_splat_model(path); });
}
std::vector<std::string> seed_file_kind() {
  const std::string vertices = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n";
  std::vector<std::string> seeds{
      '\0' + vertices + "property float f_anchor_feat_0\nend_header\n",
      '\0' + vertices + "element face 1\nproperty list uchar int vertex_indices\nend_header\n",
      std::string("\1") + R"({"version": 2, "means": {}, "quats": {"codebook": [1, null]}})",
      std::string("\1") + R"({"filenames": ["part/meta.json"], "tree": {"lods": {}}})",
      std::string("\1") + R"( {"frames": [], "camera_model": "OPENCV"})"};
  for (const char* member : {"scan/points3D.bin", "archive/data.pkl", "scene/meta.json"}) {
    ZipWriter zip;
    for (const char* name : {"scene/", member}) zip.add(name, {});
    const std::vector<std::byte> file = zip.finish();
    seeds.push_back('\2' + std::string(reinterpret_cast<const char*>(file.data()), file.size()));
  }
  write_spz(folder() / "s.spz", few_splats(0));  // compressed with gzip
  seeds.push_back('\3' + get(folder() / "s.spz"));
  return seeds;
}

// Tests only the headers that ubs parses itself. Files of JPEG start with 0xff, and those of PNG with 0x89.
void run_image_header(Data d) {
  if (d.size() < 2 || !(d[0] == 0xff || d[0] == 0x89)) return;
  const fs::path path = put("x.jpg", d);
  expect_error_only([&] { image_file_info(path); });
}
std::vector<std::string> seed_image_header() {
  save_png(folder() / "s.png", {2, 2, std::vector<std::uint8_t>(12, 9)});
  std::string jpeg(
      "\xff\xd8\xff\xe1\x00\x22"
      "Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0",
      38);
  jpeg += std::string("\xff\xc0\x00\x0b\x08\x00\x10\x00\x20\x01\x01\x11\x00", 13);
  return {get(folder() / "s.png"), jpeg};
}

}  // namespace

std::span<const Target> targets() {
  static const Target kTargets[] = {
      {"ply", run_ply, seed_ply},
      {"spz", run_spz, seed_spz},
      {"splat32", run_splat32, seed_splat32},
      {"colmap_binary", run_colmap_binary, seed_colmap_binary},
      {"colmap_text", run_colmap_text, seed_colmap_text},
      {"json", run_json, seed_json},
      {"cameras", run_cameras, seed_cameras},
      {"npy", run_npy, seed_npy},
      {"image_header", run_image_header, seed_image_header},
      {"safetensors", run_safetensors, seed_safetensors},
      {"packed", run_packed, seed_packed},
      {"image", run_image, seed_image},
      {"video", run_video, seed_video},
      {"checkpoint", run_checkpoint, seed_checkpoint},
      {"run_folder", run_run_folder, seed_run_folder},
      {"keyframes", run_keyframes, seed_keyframes},
      {"ubsz", run_ubsz, seed_ubsz},
      {"glb", run_glb, seed_glb},
      {"sog", run_sog, seed_sog},
      {"streamed_sog", run_streamed_sog, seed_streamed_sog},
      {"usda", run_usda, seed_usda},
      {"file_kind", run_file_kind, seed_file_kind},
  };
  return kTargets;
}

}  // namespace ubs::fuzz
