// SPDX-License-Identifier: Apache-2.0
// Tests PLY files of splats: the exact bytes (docs/method.md, section 5.1), properties in other orders and
// types, and errors. Point clouds use the same code for headers, and are also tested here.
#include "host/formats/ply.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include "host/dataset/world_points.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

SplatModel numbered_model(int dim, std::size_t count) {
  SplatModel model(dim, count);
  for (std::size_t i = 0; i < model.values.size(); ++i) model.values[i] = 0.25f * static_cast<float>(i) - 7;
  return model;
}

constexpr const char* kHeader6 =
    "ply\nformat binary_little_endian 1.0\nelement vertex 2\n"
    "property float x\nproperty float y\nproperty float z\n"
    "property float red\nproperty float green\nproperty float blue\nproperty float opacity\n"
    "property float beta_0\nproperty float beta_1\nproperty float beta_2\nproperty float beta_3\n"
    "property float mean_0\nproperty float mean_1\nproperty float mean_2\n"
    "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"
    "property float scale_3\nproperty float scale_4\nproperty float scale_5\n"
    "property float l_triangle_0\nproperty float l_triangle_1\nproperty float l_triangle_2\n"
    "property float l_triangle_3\nproperty float l_triangle_4\nproperty float l_triangle_5\n"
    "property float l_triangle_6\nproperty float l_triangle_7\nproperty float l_triangle_8\n"
    "property float l_triangle_9\nproperty float l_triangle_10\nproperty float l_triangle_11\n"
    "property float l_triangle_12\nproperty float l_triangle_13\nproperty float l_triangle_14\nend_header\n";

// Returns a valid file with two splats of N = 6. The tests of errors below modify it.
std::string valid_text(const TempFolder& folder) {
  write_splat_ply(folder / "valid.ply", numbered_model(6, 2));
  return get(folder / "valid.ply");
}

}  // namespace

TEST_CASE("layout: the numbers of parameters agree with docs/method.md", "[ply]") {
  CHECK(ParameterLayout(3).count == 14);
  CHECK(ParameterLayout(6).count == 35);
  CHECK(ParameterLayout(7).count == 44);
  for (int dim = kMinDim; dim <= kMaxDim; ++dim) {
    const ParameterLayout layout(dim);
    CHECK(layout.count == dim * (dim + 1) / 2 + 2 * dim + 2);
    CHECK(layout.property_names().size() == static_cast<std::size_t>(layout.count));
    int next = 0;
    for (const ParameterGroup& group : parameter_groups(layout)) {
      CHECK(group.first == next);
      next += group.count;
    }
    CHECK(next == layout.count);
  }
  CHECK(ParameterLayout(7).property_names()[static_cast<std::size_t>(ParameterLayout(7).mean) + 3] ==
        "mean_3");
  CHECK_THAT(message_of([] { ParameterLayout(2); }, ErrorKind::usage), Contains("N = 2"));
  CHECK_THAT(message_of([] { SplatModel(12, 1); }, ErrorKind::usage), Contains("N = 12"));
}

TEST_CASE("ply: a written file has the expected header and vertex-major data", "[ply]") {
  TempFolder folder;
  const SplatModel model = numbered_model(6, 2);
  write_splat_ply(folder / "a.ply", model);
  const std::string text = get(folder / "a.ply");
  REQUIRE(text.size() == std::strlen(kHeader6) + 2 * 140);
  CHECK(text.substr(0, std::strlen(kHeader6)) == kHeader6);
  for (std::size_t i = 0; i < 2; ++i)
    for (std::size_t r = 0; r < 35; ++r) {
      float value = 0;
      std::memcpy(&value, text.data() + std::strlen(kHeader6) + 140 * i + 4 * r, 4);
      CHECK(value == model.row(static_cast<int>(r))[i]);
    }
}

TEST_CASE("ply: for every N, a file has the expected size and is read back unchanged", "[ply]") {
  TempFolder folder;
  const std::size_t count = GENERATE(std::size_t{1}, std::size_t{4097});
  for (int dim = kMinDim; dim <= kMaxDim; ++dim) {
    const SplatModel model = numbered_model(dim, count);
    write_splat_ply(folder / "a.ply", model);
    const SplatModel back = read_splat_ply(folder / "a.ply");
    CHECK(back.dim == dim);
    CHECK(back.count == count);
    CHECK(back.values == model.values);
    const std::string text = get(folder / "a.ply");
    const std::size_t data = text.size() - text.find("end_header\n") - 11;
    CHECK(data == 4 * count * static_cast<std::size_t>(model.layout().count));
    if (dim == 7) CHECK(data == 176 * count);
    write_splat_ply(folder / "b.ply", back);
    CHECK(get(folder / "b.ply") == text);
  }
  CHECK(file_count(folder.path()) == 2);
}

TEST_CASE("ply: comments are written and read back", "[ply]") {
  TempFolder folder;
  const std::vector<std::string> comments{"made by hand", "second  line"};
  write_splat_ply(folder / "a.ply", numbered_model(6, 2), comments);
  const std::string expected =
      replaced(kHeader6, "element", "comment made by hand\ncomment second  line\nelement");
  CHECK(get(folder / "a.ply").substr(0, expected.size()) == expected);
  std::vector<std::string> back;
  read_splat_ply(folder / "a.ply", &back);
  CHECK(back == comments);
  const std::vector<std::string> paths{"two\nlines", "caf\xe9 \\x41"};  // bytes of a path
  write_splat_ply(folder / "b.ply", numbered_model(6, 2), paths);
  back.clear();
  read_splat_ply(folder / "b.ply", &back);
  CHECK(back == paths);
  const std::vector<std::string> switch_like{"ubs cov_mode whiten"};
  CHECK_THAT(message_of([&] { write_splat_ply(folder / "b.ply", numbered_model(6, 2), switch_like); },
                        ErrorKind::internal),
             Contains("read as a setting"));
}

TEST_CASE("ply: properties are read in any order and type, also between unknown properties", "[ply]") {
  TempFolder folder;
  std::string header =
      "ply\r\nformat binary_little_endian 1.0\r\nobj_info made by hand\r\nelement vertex 1\r\n";
  std::string data;
  const auto append = [&](const char* type, const std::string& name, auto value) {
    header += std::string("property ") + type + " " + name + "\r\n";
    data.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  append("double", "nx", std::numeric_limits<double>::quiet_NaN());  // unknown, so it is not checked
  append("uchar", "junk", std::uint8_t{9});
  auto names = ParameterLayout(3).property_names();
  for (std::size_t k = names.size(); k-- > 0;) {
    if (k == 0)
      append("double", names[k], 1.5);
    else if (k == 1)
      append("short", names[k], std::int16_t{-2});
    else if (k == 2)
      append("uint32", names[k], std::uint32_t{70000});
    else
      append("float32", names[k], static_cast<float>(k));
  }
  put(folder / "a.ply", header +
                            "element face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n" +
                            data + std::string(5, 'f'));
  const SplatModel model = read_splat_ply(folder / "a.ply");
  CHECK(model.dim == 3);
  CHECK(model.values[0] == 1.5f);
  CHECK(model.values[1] == -2.0f);
  CHECK(model.values[2] == 70000.0f);
  for (std::size_t k = 3; k < names.size(); ++k) CHECK(model.values[k] == static_cast<float>(k));
}

TEST_CASE("ply: errors contain file, position and reason", "[ply]") {
  TempFolder folder;
  const std::string valid = valid_text(folder);
  const auto refusal = [&](const std::string& content) {
    put(folder / "x.ply", content);
    return message_of([&] { read_splat_ply(folder / "x.ply"); });
  };
  const auto changed = [&](const std::string& from, const std::string& to) {
    return refusal(replaced(valid, from, to));
  };
  CHECK(refusal(valid).empty());
  CHECK_THAT(message_of([&] { read_splat_ply(folder / "none.ply"); }), Contains("none.ply: no such file"));
  CHECK_THAT(refusal(""), Contains("x.ply: the PLY header has no end_header"));
  CHECK_THAT(refusal("solid\n"), Contains("x.ply: not a PLY file"));
  CHECK_THAT(refusal(valid.substr(0, 60)), Contains("no end_header"));
  CHECK_THAT(refusal(valid.substr(0, valid.size() - 1)),
             Contains("announces 2 vertices, but the file contains 1"));
  CHECK_THAT(refusal(valid + "x"), Contains("1 unexpected bytes"));
  CHECK_THAT(changed("vertex 2", "vertex 3"), Contains("truncated"));
  CHECK_THAT(changed("vertex 2", "vertex 18446744073709551615"), Contains("truncated"));
  CHECK_THAT(changed("vertex 2", "vertex 99999999999999999999999"),
             Contains("x.ply:3: invalid vertex count"));
  CHECK_THAT(changed("vertex 2", "vertex -1"), Contains("invalid vertex count '-1'"));
  CHECK_THAT(changed("vertex 2", "vertex nan"), Contains("invalid vertex count 'nan'"));
  for (std::size_t length = 0; length < valid.size(); length += 13)
    CHECK_THAT(refusal(valid.substr(0, length)), Contains("x.ply"));
  CHECK_THAT(changed("element vertex 2\n", ""), Contains("there is a property before any element"));
  CHECK_THAT(changed("element vertex", "element face"), Contains("must be vertex"));
  CHECK_THAT(changed("binary_little_endian", "ascii"), Contains("x.ply:2: PLY format 'ascii'"));
  CHECK_THAT(changed("binary_little_endian", "binary_big_endian"), Contains("binary_big_endian"));
  CHECK_THAT(changed("format binary_little_endian 1.0\n", ""), Contains("no format line"));
  CHECK_THAT(changed("float opacity", "list uchar int opacity"), Contains("list properties"));
  CHECK_THAT(changed("float opacity", "quad opacity"), Contains("unknown property type 'quad'"));
  CHECK_THAT(changed("property float opacity", "nonsense"), Contains("x.ply:10: unknown PLY header line"));
  CHECK_THAT(changed("float green", "float red"), Contains("'red' appears twice"));
  CHECK_THAT(changed("float opacity", "float other"), Contains("property 'opacity' is missing for N = 6"));
  CHECK_THAT(changed("float beta_2", "float beta_x"), Contains("property 'beta_2' is missing"));
  CHECK_THAT(changed("float beta_2", "float l_triangle_15"), Contains("property 'beta_2' is missing"));
  CHECK_THAT(changed("float scale_5", "float scale_6"), Contains("property 'scale_5' is missing"));
  CHECK_THAT(changed("float scale_5", "float unknown"), Contains("4 beta_* properties, but N = 5"));
  CHECK_THAT(changed("float l_triangle_14", "float l_triangle_y"), Contains("'l_triangle_14' is missing"));
}

TEST_CASE("ply: surplus numbered properties and third-party files are rejected", "[ply]") {
  TempFolder folder;
  const auto refusal = [&](const std::vector<std::string>& names) {
    std::string text = "ply\nformat binary_little_endian 1.0\nelement vertex 0\n";
    for (const auto& name : names) text += "property float " + name + "\n";
    put(folder / "x.ply", text + "end_header\n");
    return message_of([&] { read_splat_ply(folder / "x.ply"); });
  };
  auto surplus = ParameterLayout(6).property_names();
  surplus.push_back("mean_3");
  CHECK_THAT(refusal(surplus), Contains("4 mean_* properties, but N = 6 (number of scale_*) needs 3"));
  CHECK_THAT(refusal({"x", "y", "z", "f_dc_0", "scale_0", "scale_1", "scale_2"}),
             Contains("'red' is missing") && Contains("3D Gaussian splatting"));
  CHECK_THAT(refusal({"x", "y", "z", "sb_params_0", "scale_0", "scale_1", "scale_2"}), Contains("DBS"));
  CHECK_THAT(refusal({"x", "y", "z"}), Contains("0 scale_* properties"));
}

TEST_CASE("ply: non-finite values are detected in reading and writing", "[ply]") {
  TempFolder folder;
  std::string text = valid_text(folder);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(text.data() + std::strlen(kHeader6) + 140 + 4 * 6, &nan, 4);  // splat 1, opacity
  put(folder / "x.ply", text);
  CHECK_THAT(message_of([&] { read_splat_ply(folder / "x.ply"); }),
             Contains("x.ply: vertex 1: property 'opacity' is nan"));
  SplatModel model = numbered_model(6, 5);
  model.row(8)[3] = std::numeric_limits<float>::infinity();
  CHECK_THAT(message_of([&] { write_splat_ply(folder / "y.ply", model); }, ErrorKind::numerical),
             Contains("in splat 3, 'beta_1' is inf"));
  CHECK_FALSE(std::filesystem::exists(folder / "y.ply"));
  model.values.pop_back();
  CHECK_THAT(message_of([&] { write_splat_ply(folder / "y.ply", model); }, ErrorKind::internal),
             Contains("need 175"));
}

TEST_CASE("point cloud: positions and colours are read, and invalid colours are rejected", "[ply]") {
  TempFolder folder;
  const std::string start = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n";
  const std::string axes = "property float y\nproperty float z\n", normals = "property float nx\n";
  const std::string colours = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  const float values[4] = {1, 2, 3, 0};
  const std::string data(reinterpret_cast<const char*>(values), 16);
  put(folder / "points3d.ply", start + axes + normals + colours + "end_header\n" + data + "\x0a\x14\xff");
  const WorldPoints cloud = read_world_points(folder / "points3d.ply");
  CHECK(cloud.positions == std::vector<std::array<double, 3>>{{1, 2, 3}});
  CHECK(cloud.colours == std::vector<std::array<std::uint8_t, 3>>{{10, 20, 255}});

  put(folder / "grey.ply", start + axes + normals + "end_header\n" + data);
  CHECK(read_world_points(folder / "grey.ply").colours ==
        std::vector<std::array<std::uint8_t, 3>>{{127, 127, 127}});
  put(folder / "bad.ply", start + "end_header\n" + data.substr(0, 4));
  CHECK_THAT(message_of([&] { read_world_points(folder / "bad.ply"); }), Contains("property 'y' is missing"));
  for (const auto& [red, message] :
       {std::pair{"300", "from 0 to 255 or from 0 to 1, found 300"}, {"nan", "'red'"}}) {
    put(folder / "bad.ply",
        fmt::format("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                    "property float z\nproperty float red\nproperty float green\nproperty float blue\n"
                    "end_header\n1 2 3 {} 0 0\n",
                    red));
    CHECK_THAT(message_of([&] { read_world_points(folder / "bad.ply"); }), Contains(message));
  }
}

TEST_CASE("point cloud: an ascii file must contain exactly the announced rows", "[ply]") {
  TempFolder folder;
  const std::string start =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
  const auto read = [&](const std::string& text) {
    put(folder / "a.ply", text);
    return message_of([&] { read_world_points(folder / "a.ply"); });
  };
  CHECK(read(start + "end_header\n1 2 3\n4 5 6\n").empty());
  CHECK(read(start + "end_header\n1 2 3 \r\n4 5 6\r\n\n \n").empty());
  CHECK(read(start + "end_header\n1 2 3\n4 5 6").empty());
  CHECK_THAT(read(start + "end_header\n1 2 3\n4 5 6\n7 8 9\n"),
             Contains("at least 1 rows follow the vertices"));
  CHECK_THAT(read(start + "end_header\n1 2 3 4\n4 5 6\n"), Contains("more values than the 3 properties"));
  const std::string faces =
      start + "element face 2\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n4 5 6\n";
  CHECK(read(faces + "3 0 1 1\n3 0 0 1\n").empty());
  CHECK_THAT(read(faces + "3 0 1 1\n"),
             Contains("only 1 rows follow the vertices, but the header announces 2"));
  CHECK_THAT(read(start + "end_header\n1 2 1e300\n4 5 6\n"), Contains("point 0 = 1e+300"));
}
