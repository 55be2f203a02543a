// SPDX-License-Identifier: Apache-2.0
// Tests third-party splat files: readers and writers, damaged files, real files, and the conversion of ubs
// splats to Gaussians. Tests UBSZ files, too. usd_test.cpp tests USD files.
#include <sys/mman.h>

#include <algorithm>
#include <cstring>

#include "host/base/crc32.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/gaussian_model.hpp"
#include "host/formats/ply.hpp"
#include "host/formats/reduce_splats.hpp"
#include "host/formats/splat_file.hpp"
#include "host/formats/ubsz.hpp"
#include "host/formats/zip.hpp"
#include "host/scene/initialise.hpp"
#include "tests/support/data.hpp"
#include "tests/support/splats.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

TEST_CASE("formats: 3DGS PLY keeps the bits of all values except rotations", "[formats]") {
  TempFolder folder;
  for (const int degree : {0, 1, 2, 3}) {
    ImportedSplats splats = random_splats(50, degree);
    splats.offset = {1e6, -2.5, 0};
    write_gaussian_ply(folder / "a.ply", splats);
    CHECK(detect_splat_format(folder / "a.ply").name == "3dgs");
    const ImportedSplats back = read_foreign_splats(folder / "a.ply");
    CHECK(back.sh == splats.sh);
    CHECK(back.positions == splats.positions);
    CHECK(back.log_scales == splats.log_scales);
    CHECK(back.opacity_logits == splats.opacity_logits);
    CHECK(back.offset == splats.offset);
    CHECK(compare(splats, back).rotation < 1e-6);
  }
}

TEST_CASE("formats: properties in any order, additional properties and DBS files are read", "[formats]") {
  TempFolder folder;
  const std::string names[] = {"rot_3",   "rot_2",   "rot_1", "rot_0",   "extra",      "scale_2",
                               "scale_1", "scale_0", "beta",  "opacity", "sh0_2",      "sh0_1",
                               "sh0_0",   "z",       "y",     "x",       "sb_params_0"};
  std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n", bytes;
  for (const std::string& n : names) header += "property float " + n + "\n";
  const float values[] = {0, 0, 0, 2, 99, -3, -2, -1, 0.7f, 0.25f, 0.3f, 0.2f, 0.1f, 6, 5, 4, 8};
  bytes.assign(reinterpret_cast<const char*>(values), sizeof values);
  put(folder / "dbs.ply", header + "end_header\n" + bytes);
  CHECK(detect_splat_format(folder / "dbs.ply").name == "dbs");
  const ImportedSplats s = read_foreign_splats(folder / "dbs.ply");
  CHECK(s.positions[0] == std::array<float, 3>{4, 5, 6});
  CHECK(s.rotations[0] == std::array<float, 4>{1, 0, 0, 0});
  CHECK(s.betas[0] == 0.7f);
  REQUIRE(s.report.notes.size() == 2);
  CHECK_THAT(s.report.notes[0], Contains("lobes of the colours are dropped"));
  CHECK_THAT(s.report.notes[1], Contains("not used: extra, sb_params_0"));
  const SplatModel model = exact_model(s);
  const ParameterLayout l = model.layout();
  CHECK(model.row(l.beta)[0] == 0.7f);
  CHECK(std::log1p(std::exp(model.row(l.scale + 1)[0])) == Approx(std::exp(-2.0)));
  CHECK(model.row(l.rgb)[0] == 0.1f);
}

TEST_CASE("formats: SPZ and .splat preserve values up to their quantisation", "[formats]") {
  TempFolder folder;
  const ImportedSplats splats = random_splats(300, 3);
  write_spz(folder / "a.spz", splats);
  CHECK(detect_splat_format(folder / "a.spz").name == "spz");
  Differences d = compare(splats, read_foreign_splats(folder / "a.spz"));
  // Each bound is half a quantisation step: 2^-13 for positions, 1/32 for logarithms of scales, 1/510 for
  // opacities, 0.5 / 255 / 0.15 for constant harmonics, and 1/256 for the other harmonics. No value of the
  // test exceeds the range of its field.
  CHECK(d.position <= 0.00013);
  CHECK(d.log_scale <= 0.0313);
  CHECK(d.rotation < 3e-6);
  CHECK(d.opacity <= 0.00197);
  CHECK(d.dc <= 0.0131);
  CHECK(d.rest <= 0.00391);
  CHECK(d.rest > 0.001);

  write_splat32(folder / "a.splat", splats);
  CHECK(std::filesystem::file_size(folder / "a.splat") == 300 * 32);
  std::filesystem::copy_file(folder / "a.splat", folder / "A.SPLAT");
  CHECK(detect_splat_format(folder / "A.SPLAT").name == "splat");
  d = compare(splats, read_foreign_splats(folder / "a.splat"));
  CHECK(d.position == 0);
  CHECK(d.log_scale < 1e-6);
  CHECK(d.rotation < 2e-4);
  CHECK(d.opacity <= 0.00197);
  CHECK(d.dc <= 0.00696);
}

TEST_CASE("formats: GLB preserves values up to the precision of float32, and the translation", "[formats]") {
  TempFolder folder;
  for (const int degree : {0, 1, 2, 3}) {
    ImportedSplats splats = random_splats(70, degree);
    splats.offset = {1e6, -2.5, 7};
    write_glb(folder / "a.glb", splats);
    CHECK(detect_splat_format(folder / "a.glb").name == "glb");
    const ImportedSplats back = read_foreign_splats(folder / "a.glb");
    const Differences d = compare(splats, back);
    CHECK(back.sh == splats.sh);
    CHECK(back.positions == splats.positions);
    CHECK(back.offset == splats.offset);
    CHECK(load_splat_model(folder / "a.glb").comments ==
          std::vector<std::string>{"ubs_up 0 -1 0", "ubs_offset 1000000 -2.5 7"});
    CHECK(d.rotation < 1e-6);
    CHECK(d.log_scale < 2e-6);  // exp and log are computed in float32; observed difference: 4.8e-7
    CHECK(d.opacity < 2e-7);
  }
  // A translation that float32 can store is added to the positions, so that other formats store it too.
  ImportedSplats near = random_splats(70, 3);
  near.offset = {100, -2.5, 7};
  write_glb(folder / "a.glb", near);
  const ImportedSplats moved_splats = read_foreign_splats(folder / "a.glb");
  CHECK(moved_splats.offset == std::array<double, 3>{});
  for (std::size_t i = 0; i < 70; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      CHECK(moved_splats.positions[i][k] == static_cast<float>(near.positions[i][k] + near.offset[k]));

  const std::string file = get(folder / "a.glb");
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string bytes = file;
    REQUIRE(from.size() == to.size());
    REQUIRE(bytes.find(from) != std::string::npos);
    bytes.replace(bytes.find(from), from.size(), to);
    return message_of([&] { parse_glb(std::as_bytes(std::span(bytes)), "b.glb"); });
  };
  CHECK_THAT(changed("\"count\":70", "\"count\":79"),
             Contains("b.glb: accessor 0 does not fit into the file"));
  CHECK_THAT(changed("\"ellipse\"", "\"ellipsx\""), Contains("kernel 'ellipsx'"));
  CHECK_THAT(changed("splatting:OPACITY", "splatting:OPACITx"), Contains("OPACITY is missing"));
  CHECK_THAT(changed("\"translation\":[100.0,2.5,-7.0]", "\"rotation\":[0,0,0,0]          "),
             Contains("a rotation of length 0"));
  std::string cut = file.substr(0, file.size() - 1);
  CHECK_THAT(message_of([&] { parse_glb(std::as_bytes(std::span(cut)), "b.glb"); }), Contains("truncated"));
  CHECK(parse_glb(std::as_bytes(std::span(file)), "b.glb").report.notes.empty());
  std::string linear = file;
  linear.replace(linear.find("\"srgb_rec709_display\""), 21, "\"lin_rec709_display\" ");
  const auto notes = parse_glb(std::as_bytes(std::span(linear)), "b.glb").report.notes;
  REQUIRE(notes.size() == 1);
  CHECK_THAT(notes[0], Contains("linear light (lin_rec709_display)"));

  // Returns the file with other fields in the node. The length of the JSON is stored at byte 12.
  const auto with_node = [&](const std::string& fields) {
    const std::string from = R"("translation":[100.0,2.5,-7.0])";
    std::uint32_t length = 0;
    std::memcpy(&length, file.data() + 12, sizeof length);
    std::string text = file.substr(20, length);
    REQUIRE(text.find(from) != std::string::npos);
    text.replace(text.find(from), from.size(), fields);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    std::string bytes = file.substr(0, 20) + text + file.substr(20 + length);
    length = static_cast<std::uint32_t>(text.size());
    std::memcpy(bytes.data() + 12, &length, sizeof length);
    return bytes;
  };
  const auto place = [&](const std::string& fields) {
    const std::string bytes = with_node(fields);
    return parse_glb(std::as_bytes(std::span(bytes)), "b.glb").offset;
  };
  const std::string move = R"("translation":[100,2.5,-7])";
  const std::array<double, 3> moved{100, -2.5, 7};
  CHECK(place(move + R"(,"rotation":[0,0,0,1],"scale":[1,1,1])") == moved);
  CHECK(place(R"("rotation":[0,-0.0,1.2e-7,-0.9999999],"scale":[1.0000001,1,0.9999999],)" + move) == moved);
  CHECK(place(R"("matrix":[1,0,0,0,0,1,0,0,0,0,1,0,100,2.5,-7,1])") == moved);
  CHECK(place(R"("rotation":[0,0,0,1])") == std::array<double, 3>{});
  const auto refusal = [&](const std::string& fields) { return message_of([&] { place(fields); }); };
  CHECK_THAT(refusal(R"("scale":[1,1])"), Contains("b.glb: node 0: 'scale' must have 3 numbers"));
  CHECK_THAT(refusal(R"("scale":[1,1,"2"])"), Contains("the JSON does not match"));
}

TEST_CASE("formats: SOG preserves values up to its codebooks and palette", "[formats]") {
  TempFolder folder;
  // The order of the splats changes, so each is identified by its position.
  const auto matched = [](const ImportedSplats& a, const ImportedSplats& b) {
    REQUIRE(a.count() == b.count());
    ImportedSplats out = b;
    for (std::size_t i = 0; i < a.count(); ++i) {
      const auto far = [&](std::size_t k) {
        double d = 0;
        for (std::size_t c = 0; c < 3; ++c) d += std::pow(a.positions[i][c] - b.positions[k][c], 2);
        return d;
      };
      std::size_t best = 0;
      for (std::size_t k = 1; k < b.count(); ++k)
        if (far(k) < far(best)) best = k;
      out.positions[i] = b.positions[best], out.log_scales[i] = b.log_scales[best];
      out.rotations[i] = b.rotations[best], out.opacity_logits[i] = b.opacity_logits[best];
      std::copy_n(&b.sh[best * 3 * b.coefficients()], 3 * b.coefficients(),
                  &out.sh[i * 3 * b.coefficients()]);
    }
    return out;
  };
  for (const int degree : {0, 1, 3}) {
    const ImportedSplats splats = random_splats(300, degree);
    write_sog(folder / "a.sog", splats);
    CHECK(detect_splat_format(folder / "a.sog").name == "sog");
    const Differences d = compare(splats, matched(splats, read_foreign_splats(folder / "a.sog")));
    // The errors are at most half a quantisation step. Logarithms of positions have 16 bits for the range
    // from -ln 4 to ln 4, which gives the largest step at |v| = 3. Scales and harmonics have about 256 values
    // in their range, and opacities have 8 bits. The observed errors are about half of these bounds.
    CHECK(d.position < 1.8e-4);
    CHECK(d.log_scale < 0.03);
    CHECK(d.rotation < 4e-5);
    CHECK(d.opacity <= 0.00197);
    CHECK(d.dc < 0.014);
    CHECK(d.rest < 0.014);
    CHECK((degree == 0 || d.rest > 1e-4));
  }
  // If there are more splats than entries of the palette, similar splats share an entry.
  ImportedSplats many = random_splats(70000, 1);
  for (std::size_t i = 0; i < many.count(); ++i)
    for (std::size_t k = 3; k < 12; ++k) many.sh[12 * i + k] = static_cast<float>(i % 50) / 60;
  write_sog(folder / "m.sog", many);
  const ImportedSplats back = read_foreign_splats(folder / "m.sog");
  std::array<std::size_t, 50> seen{};
  for (std::size_t i = 0; i < back.count(); ++i) {
    const double value = back.sh[12 * i + 3] * 60;
    CHECK(std::abs(value - std::round(value)) < 1e-3);
    ++seen.at(static_cast<std::size_t>(std::lround(value)));
  }
  CHECK(std::ranges::all_of(seen, [](std::size_t n) { return n == 1400; }));

  const std::string file = get(folder / "a.sog");
  std::string bad = file;
  bad[bad.find("VP8L") + 40] ^= 1;
  CHECK_THAT(message_of([&] { parse_sog(std::as_bytes(std::span(bad)), "b.sog"); }),
             Contains("b.sog: means_l.webp: the file is damaged"));
  bad = file.substr(0, file.size() - 1);
  CHECK_THAT(message_of([&] { parse_sog(std::as_bytes(std::span(bad)), "b.sog"); }), Contains("truncated"));
  put(folder / "no.sog", "PK\3\4 and no more");
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "no.sog"); }), Contains("ZIP"));
}

TEST_CASE("formats: values that SPZ cannot store are reported", "[formats]") {
  const TempFolder folder;
  ImportedSplats splats = random_splats(20, 1);
  CHECK(spz_remarks(splats).empty());
  splats.positions[0][0] = 1e6f;
  splats.log_scales[1][2] = 9;
  splats.sh[2 * 12] = 30;     // a harmonic of degree 0
  splats.sh[3 * 12 + 5] = 5;  // a harmonic of degree 1
  const std::vector<std::string> remarks = spz_remarks(splats);
  REQUIRE(remarks.size() == 2);
  CHECK_THAT(remarks[0], Contains("steps of 0.125"));
  CHECK_THAT(remarks[1], Contains("3 splats") && Contains("clipped"));
  write_spz(folder / "a.spz", splats);
  const ImportedSplats back = read_foreign_splats(folder / "a.spz");
  CHECK(back.positions[0][0] == 1e6f);
  CHECK(std::remainder(back.positions[4][1], 0.125f) == 0);
  CHECK(back.log_scales[1][2] == 5.9375f);
}

TEST_CASE("formats: SPZ rotates harmonics like the positions", "[formats]") {
  // The axes of an SPZ file are rotated by half a turn about x. The writer and the reader must rotate
  // harmonics together with the positions, so that the colours seen from a point do not change.
  TempFolder folder;
  const ImportedSplats splats = random_splats(20, 3);
  write_spz(folder / "a.spz", splats);
  const ImportedSplats back = read_spz(folder / "a.spz");
  const auto a = colours_from(splats, {9, -8, 7}), b = colours_from(back, {9, -8, 7});
  for (std::size_t i = 0; i < a.size(); ++i)
    for (std::size_t c = 0; c < 3; ++c) CHECK(std::abs(a[i][c] - b[i][c]) < 0.02);
}

namespace {

std::string number_text(std::uint64_t value, std::size_t bytes) {
  return {reinterpret_cast<const char*>(&value), bytes};
}

// Returns the record of an SPZ extension with one 32-bit number.
std::string spz_record(std::uint32_t type, std::uint32_t number) {
  return number_text(type, 4) + number_text(4, 4) + number_text(number, 4);
}

// Returns the data of an SPZ file of version 3 with the flag "has extensions" and these records at the end.
std::string spz_with(const std::filesystem::path& path, const std::string& records) {
  const std::string packed = get(path);
  const std::vector<std::byte> plain = inflate_gzip(std::as_bytes(std::span(packed)), 1 << 20, "test");
  std::string text(reinterpret_cast<const char*>(plain.data()), plain.size());
  text[14] |= 2;
  return text + records;
}

// Returns the same splats as an SPZ file of version 4, whose Zstandard streams are not compressed.
std::string spz_v4_of(const std::string& v3, std::size_t records) {
  std::uint32_t count = 0;
  std::memcpy(&count, v3.data() + 8, sizeof count);
  const int degree = v3[12];
  std::string table, streams;
  std::size_t at = 16;
  for (const int width : {9, 1, 3, 3, 4, 3 * ((degree + 1) * (degree + 1) - 1)}) {
    const std::size_t size = count * static_cast<std::size_t>(width);
    const std::string stream = number_text(0xfd2fb528, 4) + "\xa0" + number_text(size, 4) +
                               number_text(size << 3 | 1, 3) + v3.substr(at, size);
    table += number_text(stream.size(), 8) + number_text(size, 8);
    streams += stream;
    at += size;
  }
  REQUIRE(at + records == v3.size());
  return v3.substr(0, 4) + number_text(4, 4) + v3.substr(8, 7) + "\6" + number_text(32 + records, 4) +
         std::string(12, '\0') + v3.substr(at) + table + streams;
}

}  // namespace

TEST_CASE("formats: SPZ files are converted from the coordinate system that an extension states",
          "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(20, 3);
  write_spz(folder / "a.spz", splats);  // in the system RUB
  const ImportedSplats plain = read_spz(folder / "a.spz");
  constexpr std::uint32_t kType = 0xadbe0003;
  constexpr std::string_view kSystems[] = {"RUB", "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF"};
  for (std::uint32_t system = 0; system <= 8; ++system) {
    INFO(system);
    const std::string_view axes = kSystems[system];
    const std::array<float, 3> mirror{axes[0] == 'R' ? 1.0f : -1.0f, axes[1] == 'U' ? 1.0f : -1.0f,
                                      axes[2] == 'B' ? 1.0f : -1.0f};
    const std::string v3 = spz_with(folder / "a.spz", spz_record(kType, system));
    put(folder / "v3.spz", v3);
    put(folder / "v4.spz", spz_v4_of(v3, 12));
    for (const char* name : {"v3.spz", "v4.spz"}) {
      INFO(name);
      const ImportedSplats back = read_spz(folder / name);
      REQUIRE(back.count() == 20);
      CHECK(back.report.notes.empty());
      const auto a = colours_from(plain, {9, -8, 7}),
                 b = colours_from(back, {9 * mirror[0], -8 * mirror[1], 7 * mirror[2]});
      for (std::size_t i = 0; i < 20; ++i) {
        const auto covariance = [&](const ImportedSplats& s) {
          const auto& q = s.rotations[i];
          const auto& l = s.log_scales[i];
          return covariance_of({q[0], q[1], q[2], q[3]}, {std::exp(l[0]), std::exp(l[1]), std::exp(l[2])});
        };
        Mat3 expected = covariance(plain);
        for (std::size_t r = 0; r < 3; ++r) {
          CHECK(back.positions[i][r] == mirror[r] * plain.positions[i][r]);
          CHECK(b[i][r] == Approx(a[i][r]).margin(1e-6));
          for (std::size_t c = 0; c < 3; ++c) expected[r][c] *= mirror[r] * mirror[c];
        }
        CHECK(relative_difference(expected, covariance(back)) < 1e-5);
      }
    }
  }
  for (const std::uint32_t system : {9, 12, 17}) {
    put(folder / "b.spz", spz_with(folder / "a.spz", spz_record(kType, system)));
    CHECK_THAT(
        message_of([&] { read_foreign_splats(folder / "b.spz"); }),
        Contains(fmt::format("b.spz: coordinate system {} of the extension SPZ_ADOBE_coordinate", system)));
  }
}

TEST_CASE("formats: SPZ extensions that are not used give notes", "[formats]") {
  const TempFolder folder;
  write_spz(folder / "a.spz", random_splats(20, 1));
  const std::string v3 = spz_with(folder / "a.spz", spz_record(0xadbe0002, 1) + spz_record(0x12340001, 2));
  const std::vector<std::byte> packed = deflate_gzip(std::as_bytes(std::span(v3)));
  put(folder / "v3.spz", {reinterpret_cast<const char*>(packed.data()), packed.size()});
  put(folder / "v4.spz", spz_v4_of(v3, 24));
  for (const char* name : {"v3.spz", "v4.spz"}) {
    INFO(name);
    const ImportedSplats back = read_foreign_splats(folder / name);
    CHECK(back.positions == read_spz(folder / "a.spz").positions);
    REQUIRE(back.report.notes.size() == 2);
    CHECK_THAT(back.report.notes[0], Contains("SPZ_ADOBE_safe_orbit_camera"));
    CHECK_THAT(back.report.notes[1], Contains("1 extensions are ignored") && Contains("0x12340001"));
  }
  // Without the flag, the bytes are not records.
  std::string unflagged = v3;
  unflagged[14] = 0;
  put(folder / "b.spz", unflagged);
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.spz"); }),
             Contains("24 bytes follow the last splat"));
  put(folder / "b.spz", spz_v4_of(unflagged, 24));
  CHECK_THAT(read_foreign_splats(folder / "b.spz").report.notes.at(0),
             Contains("24 bytes after the header are not used"));
  put(folder / "b.spz", v3.substr(0, v3.size() - 1));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.spz"); }), Contains("b.spz: truncated"));
}

TEST_CASE("formats: invalid splats are dropped and counted, and invalid files are rejected", "[formats]") {
  TempFolder folder;
  ImportedSplats splats = random_splats(10, 1);
  splats.positions[2][1] = std::numeric_limits<float>::quiet_NaN();
  splats.rotations[5] = {0, 0, 0, 0};
  splats.log_scales[7][0] = 1000;
  write_gaussian_ply(folder / "a.ply", splats);
  const ImportedSplats back = read_foreign_splats(folder / "a.ply");
  CHECK(back.count() == 7);
  CHECK(back.report.skipped.size() == 3);
  CHECK(back.positions[2] == splats.positions[3]);

  const std::string ply = get(folder / "a.ply");
  put(folder / "b.ply", ply.substr(0, ply.size() - 5));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.ply"); }), Contains("truncated"));
  std::string renamed = ply;
  renamed.replace(renamed.find("f_rest_3"), 8, "f_rext_3");
  put(folder / "b.ply", renamed);
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.ply"); }), Contains("3 f_rest_* properties"));

  write_spz(folder / "a.spz", random_splats(100, 0));
  const std::string spz = get(folder / "a.spz");
  put(folder / "b.spz", spz.substr(0, spz.size() / 2));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.spz"); }), Contains("b.spz"));
  put(folder / "b.spz", spz + "x");
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.spz"); }),
             Contains("b.spz: 1 bytes follow the end of the gzip data"));
  std::vector<std::byte> plain = inflate_gzip(std::as_bytes(std::span(spz)), 100000, "spz");
  for (const auto& [more, message] : {std::pair{1, "b.spz: 1 bytes follow the last splat"},
                                      std::pair{999, "bytes that its header allows"}}) {
    plain.resize(plain.size() + more);
    const std::vector<std::byte> longer = deflate_gzip(plain);
    put(folder / "b.spz", {reinterpret_cast<const char*>(longer.data()), longer.size()});
    CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.spz"); }), Contains(message));
  }
  put(folder / "b.splat", std::string(33, 'x'));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.splat"); }),
             Contains("33 bytes is not a multiple"));
  put(folder / "b.splat", std::string(64, '\0'));
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "b.splat"); }), Contains("none of its records"));
  std::string v4("NGSP\x04\0\0\0\xff\xff\xff\x7f\0\x0c\0\x05\x20\0\0\0", 20);
  v4.resize(200);
  put(folder / "v4.spz", v4);
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "v4.spz"); }), Contains("stream 0"));
}

// zlib counts in 32 bits. Earlier versions neither read nor wrote the data beyond 4 GiB.
TEST_CASE("gzip: a file of more than 4 GiB is read to its end", "[import]") {
  const std::vector<std::byte> packed = deflate_gzip(std::vector<std::byte>(100, std::byte{7}));
  const std::size_t beyond = std::size_t{1} << 32, bytes = packed.size() + beyond;
  void* const room =
      mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  REQUIRE(room != MAP_FAILED);
  std::ranges::copy(packed, static_cast<std::byte*>(room));
  const std::span file(static_cast<const std::byte*>(room), bytes);
  CHECK(inflate_gzip(file.first(packed.size()), 1000, "a").size() == 100);
  CHECK_THAT(message_of([&] { inflate_gzip(file, 1000, "a"); }),
             Contains("a: 4294967296 bytes follow the end of the gzip data"));
  munmap(room, bytes);
}

// Returns a model of the published variant with random rotations and scales. Its query dimensions have no
// influence.
SplatModel neutral_model(std::size_t count, int dim) {
  SplatModel model(dim, count);
  const ParameterLayout l = model.layout();
  const CounterRandom random(3, 7);
  for (std::uint32_t i = 0; i < count; ++i) {
    for (std::uint32_t k = 0; k < 3; ++k) {
      const int axis = static_cast<int>(k);
      model.row(l.xyz + axis)[i] = static_cast<float>(random.uniform(i, k, -3, 3));
      model.row(l.scale + axis)[i] = static_cast<float>(random.uniform(i, 4 + k, -5, -1));
      model.row(l.l_triangle + axis)[i] = static_cast<float>(random.uniform(i, 8 + k, -1, 1));
    }
    model.row(l.opacity)[i] = static_cast<float>(random.uniform(i, 12, -3, 3));
    model.row(l.beta)[i] = static_cast<float>(random.uniform(i, 13, -1, 2));
    for (int q = 0; q < l.query; ++q) model.row(l.query_beta + q)[i] = -8;
  }
  return model;
}

TEST_CASE("reduce: splats that the query does not change keep covariance and opacity", "[reduce]") {
  const auto covariance = [](const ImportedSplats& s, std::size_t i) {
    const auto& q = s.rotations[i];
    return covariance_of(
        {q[0], q[1], q[2], q[3]},
        {std::exp(s.log_scales[i][0]), std::exp(s.log_scales[i][1]), std::exp(s.log_scales[i][2])});
  };
  for (const int dim : {3, 4, 6, 7}) {
    const SplatModel model = neutral_model(200, dim);
    const ParameterLayout l = model.layout();
    const ImportedSplats out = reduce_splats(model, {.time = 0.3});
    REQUIRE(out.count() == model.count);
    for (std::size_t i = 0; i < model.count; ++i) {
      const Matrix3 m = spatial_factor(model, i).m;
      const double support = support_ratio(4 * std::exp(model.row(l.beta)[i]));
      Mat3 expected{};
      for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t c = 0; c < 3; ++c)
          for (std::size_t k = 0; k < 3; ++k) expected[r][c] += m[r][k] * m[c][k] / (support * support);
      CHECK(relative_difference(expected, covariance(out, i)) < 1e-5);
      // The neutral betas give factors from 0.998 to 1.
      CHECK(sigmoid_of(out.opacity_logits[i]) ==
            Approx(sigmoid_of(model.row(l.opacity)[i])).epsilon(dim == 3 ? 1e-6 : 0.006));
    }
  }
}

TEST_CASE("reduce: splats of DBS files become Gaussians", "[reduce]") {
  ImportedSplats splats = random_splats(50, 0);
  splats.kernel = SpatialKernel::beta;
  splats.betas.assign(50, 0.5f);
  const ImportedSplats out = reduce_splats(exact_model(splats));
  CHECK(out.kernel == SpatialKernel::gaussian);
  CHECK(out.betas.empty());
  for (auto& scales : splats.log_scales)
    for (float& scale : scales) scale -= static_cast<float>(std::log(support_ratio(4 * std::exp(0.5))));
  const Differences d = compare(splats, out);
  CHECK(d.log_scale < 1e-5);
  CHECK(d.rotation < 1e-6);
  CHECK(d.opacity < 1e-6);
}

TEST_CASE("reduce: support_ratio() returns the optimal ratios of docs/method.md, section 2.7", "[reduce]") {
  CHECK(support_ratio(4) == Approx(3.08).epsilon(0.002));
  CHECK(support_ratio(4 * std::exp(0.5)) == Approx(3.82).epsilon(0.005));
  CHECK(support_ratio(4 * std::exp(1.0)) == Approx(4.81).epsilon(0.005));
  CHECK(support_ratio(4 * std::exp(2.0)) == Approx(7.78).epsilon(0.005));
}

TEST_CASE(
    "reduce: a splat that is visible from one direction has a low mean opacity and a high maximum opacity",
    "[reduce]") {
  SplatModel model = initialise_random(6, 50, 3);
  const ParameterLayout l(6);
  for (std::size_t i = 0; i < 50; ++i) {
    model.row(l.opacity)[i] = 4;
    for (int k = 0; k < 3; ++k) model.row(l.mean + k)[i] = k == 2 ? 1.0f : 0.0f;  // seen along +z only
  }
  ReduceOptions options;
  options.least_opacity = 0;
  options.opacity = "mean";
  const float mean = reduce_splats(model, options).opacity_logits[0];
  options.opacity = "max";
  const float largest = reduce_splats(model, options).opacity_logits[0];
  CHECK(sigmoid_of(mean) < 0.5f);
  CHECK(sigmoid_of(largest) > 0.7f);  // the nearest of the 32 directions differs by 14 degrees
  options.opacity = "some";
  CHECK_THAT(message_of([&] { reduce_splats(model, options); }, ErrorKind::usage), Contains("'some'"));
}

TEST_CASE("formats: UBSZ stores models exactly, or with errors of at most half a quantisation step",
          "[formats][data]") {
  const TempFolder folder;
  ModelVariant variant;
  variant.cov_mode = CovMode::whiten;
  MixedModel model(std::vector<SplatModel>{initialise_random(7, 40, 1), initialise_random(3, 2000, 2)});
  for (SplatModel& group : model.groups) group.variant = variant;
  const std::vector<std::string> comments{"ubs_drawn background=1,0.5,0"};
  const auto bytes = pack_ubsz(model, comments);
  write_file_atomically(folder / "m.ubsz", bytes);
  CHECK(detect_splat_format(folder / "m.ubsz").name == "ubs");
  const LoadedModel loaded = load_splat_model(folder / "m.ubsz");
  CHECK(loaded.comments == comments);
  REQUIRE(loaded.notes.drawing.size() == 1);
  REQUIRE(loaded.model.groups.size() == 2);
  for (std::size_t g = 0; g < 2; ++g) {
    CHECK(loaded.model.groups[g].values == model.groups[g].values);
    CHECK(loaded.model.groups[g].variant == variant);
  }

  SplatModel one = model.groups[1];
  for (std::size_t i = 0; i < one.values.size(); ++i) one.values[i] = std::sin(1.7f * static_cast<float>(i));
  one.row(5)[7] = 1e6f;  // needs more than three bytes at this step, so the row is stored exactly
  const auto rows = static_cast<std::size_t>(one.layout().count);
  UbszSteps steps{std::vector<double>(rows), std::vector<std::uint8_t>(one.count)};
  for (std::size_t r = 0; r < rows; ++r) steps.steps[r] = r < 3 ? 1e-3 : 0.01 * static_cast<double>(r);
  for (std::size_t i = 0; i < one.count; ++i) steps.classes[i] = static_cast<std::uint8_t>(i % 6);
  const SplatModel back = rounded(one, steps);
  REQUIRE(back.count == one.count);
  // Splats are ordered by class, and by position within a class. The test sorts the values of each row in a
  // class before it compares them.
  std::size_t first = 0;
  for (unsigned k = 0; k < 6; ++k) {
    const std::size_t n = (one.count + 5 - k) / 6;
    for (std::size_t r = 0; r < rows; ++r) {
      INFO("class " << k << ", row " << r);
      std::vector<float> before, after;
      for (std::size_t i = k; i < one.count; i += 6) before.push_back(one.row(static_cast<int>(r))[i]);
      for (std::size_t i = first; i < first + n; ++i) after.push_back(back.row(static_cast<int>(r))[i]);
      std::ranges::sort(before);
      std::ranges::sort(after);
      REQUIRE(before.size() == after.size());
      const double half = r == 5 ? 0 : 0.5001 * steps.steps[r] * (1 << k);
      double worst = 0;
      for (std::size_t i = 0; i < n; ++i)
        worst = std::max(worst, std::abs(static_cast<double>(after[i]) - before[i]));
      CHECK(worst <= half + 1e-6);
      if (r != 5) CHECK(worst > 0.1 * half);
    }
    first += n;
  }
  // If a file has levels, the splats of the second level follow those of the first level. Splats with the
  // same dimension are in the same group.
  const UbszLevel levels[] = {{MixedModel(model.groups[1]), {}, 20}, {model, {}, 50}};
  const UbszParts parts = pack_ubsz_levels(levels, comments);
  REQUIRE(parts.sizes.size() == 2);
  CHECK(parts.sizes[0] + parts.sizes[1] == parts.bytes.size());
  const MixedModel both = unpack_ubsz(parts.bytes, "levels");
  REQUIRE(both.groups.size() == 2);
  CHECK(both.groups[1].values == model.groups[0].values);
  REQUIRE(both.groups[0].count == 2 * model.groups[1].count);
  for (std::size_t i = 0; i < 2000; ++i) {
    CHECK(both.groups[0].row(4)[i] == model.groups[1].row(4)[i]);
    CHECK(both.groups[0].row(4)[2000 + i] == model.groups[1].row(4)[i]);
  }
  CHECK_THAT(
      message_of([&] { unpack_ubsz(std::span(parts.bytes).first(parts.sizes[0]), "cut"); }, ErrorKind::data),
      Contains("cut: truncated"));
  for (std::size_t cut = 0; cut < bytes.size(); cut += 997)
    CHECK_THAT(message_of([&] { unpack_ubsz(std::span(bytes).first(cut), "cut"); }, ErrorKind::data),
               Contains("cut"));
}

TEST_CASE("formats: many levels of UBSZ are joined in their order", "[formats]") {
  std::vector<UbszLevel> levels;
  for (int i = 0; i < 2001; ++i) {
    MixedModel model(std::vector<SplatModel>{initialise_random(i % 3 == 0 ? 6 : 3, 1, 1)});
    model.groups[0].row(0)[0] = static_cast<float>(i);
    levels.push_back({std::move(model), {}, 20});
  }
  const MixedModel all = unpack_ubsz(pack_ubsz_levels(levels, {}).bytes, "levels");
  REQUIRE(all.groups.size() == 2);
  REQUIRE(all.groups[0].count == 667);
  REQUIRE(all.groups[1].count == 1334);
  for (std::size_t i = 0; i < 667; ++i) {
    CHECK(all.groups[0].row(0)[i] == static_cast<float>(3 * i));
    CHECK(all.groups[1].row(0)[2 * i] == static_cast<float>(3 * i + 1));
    CHECK(all.groups[1].row(0)[2 * i + 1] == static_cast<float>(3 * i + 2));
  }
}

TEST_CASE("formats: a UBSZ file with a count that is too large, or is not an integer, is rejected",
          "[formats]") {
  const SplatModel one = initialise_random(6, 20, 1);
  const UbszSteps steps{std::vector<double>(static_cast<std::size_t>(one.layout().count), 0.01),
                        std::vector<std::uint8_t>(one.count)};
  const UbszLevel level{MixedModel(one), {steps}, 20};
  const std::vector<std::byte> bytes = pack_ubsz_levels(std::span(&level, 1), {}).bytes;
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  std::uint32_t size = 0;
  std::memcpy(&size, &bytes[8], sizeof size);
  const auto refusal = [&](const char* member, const Json& value) {
    Json header = parse_json(text.substr(16, size), "header");
    header[Json::json_pointer(member)] = value;
    const std::string words = header.dump();
    std::vector<std::byte> changed(bytes.begin(), bytes.begin() + 8);
    put_number(changed, static_cast<std::uint32_t>(words.size()));
    put_number(changed, crc32(std::as_bytes(std::span(words))));
    for (const char c : words) changed.push_back(static_cast<std::byte>(c));
    changed.insert(changed.end(), bytes.begin() + 16 + size, bytes.end());
    return message_of([&] { unpack_ubsz(changed, "a.ubsz"); }, ErrorKind::data);
  };
  CHECK(refusal("/levels/0/psnr", 30).empty());
  const Json wrapped = (std::uint64_t{1} << 32) + 6, fraction = 6.5, yes = true;
  const std::string group = "/levels/0/groups/0";
  for (const std::string member :
       {"/levels/0/bytes", "/dim", "/splats", "/classes/0", "/places/bytes", "/rows/0/bytes"})
    for (const Json& value : {wrapped, fraction, yes, Json(-6), Json("6")}) {
      const std::string path = member.starts_with("/levels") ? member : group + member;
      INFO(path << " = " << value.dump());
      CHECK_THAT(refusal(path.c_str(), value), Contains("a.ubsz: "));
    }
}

TEST_CASE("formats: small files that announce huge models are rejected", "[formats]") {
  const TempFolder folder;
  const auto refusal = [&](std::span<const std::byte> bytes, const char* name) {
    write_file_atomically(folder / name, bytes);
    return message_of([&] { read_foreign_splats(folder / name); });
  };
  const auto sog = [&](const std::string& meta) {
    ZipWriter zip;
    zip.add("meta.json", std::as_bytes(std::span(meta)));
    return refusal(zip.finish(), "a.sog");
  };
  CHECK_THAT(sog("{\"version\":2,\"count\":1,\"x\":[" + std::string(2'000'000, ' ') + "]}"),
             Contains("meta.json: 2000") && Contains("at most 1048576"));
  CHECK_THAT(sog("{\"version\":2,\"count\":100000}"), Contains("100000 splats cannot be stored in"));

  // Tests files with 2 and with 40 primitives that share all accessors of the first primitive.
  write_glb(folder / "a.glb", random_splats(100, 0));
  const std::string glb = get(folder / "a.glb");
  std::uint32_t words = 0;
  std::memcpy(&words, &glb[12], sizeof words);
  for (const int primitives : {2, 40}) {
    Json json = parse_json(glb.substr(20, words), "a.glb");
    Json& list = json["meshes"][0]["primitives"];
    while (list.size() < static_cast<std::size_t>(primitives)) list.push_back(Json(list[0]));
    const std::string text = json.dump();
    const auto size = static_cast<std::uint32_t>(text.size());
    std::string changed = glb.substr(0, 12) + std::string(8, '\0') + text + glb.substr(20 + words);
    std::memcpy(&changed[12], &size, sizeof size);
    std::memcpy(&changed[16], &glb[16], 4);
    const std::string message = refusal(std::as_bytes(std::span(changed)), "b.glb");
    if (primitives == 2)
      CHECK(message.empty());
    else
      CHECK_THAT(
          message,
          Contains("b.glb: 100 splats, in addition to 400 of other primitives, do not fit into the file"));
  }
}

TEST_CASE("formats: real third-party files are read", "[formats][data]") {
  UBS_REQUIRE_DATA(folder, "foreign_splats");
  const ImportedSplats graphdeco = read_foreign_splats(folder / "graphdeco_sh3_9080.ply");
  CHECK(graphdeco.count() == 9080);
  CHECK(graphdeco.sh_degree == 3);
  const ImportedSplats lego = read_foreign_splats(folder / "opensplat_lego_world.ply");
  CHECK(lego.count() == 20596);
  CHECK(lego.report.skipped.empty());

  // The two files contain the same scene, so they must contain the same splats and the same ellipsoids.
  const ImportedSplats packed = read_foreign_splats(folder / "supersplat_biker.compressed.ply");
  const ImportedSplats spz = read_foreign_splats(folder / "biker.spz");
  REQUIRE(packed.count() == 152746);
  REQUIRE(spz.count() == 152746);
  std::array<double, 3> mean_a{}, mean_b{};
  Mat3 sum_a{}, sum_b{};
  for (std::size_t i = 0; i < packed.count(); ++i)
    for (const auto& [s, mean, sum] : {std::tie(packed, mean_a, sum_a), std::tie(spz, mean_b, sum_b)}) {
      const auto& q = s.rotations[i];
      const Mat3 c = covariance_of(
          {q[0], q[1], q[2], q[3]},
          {std::exp(s.log_scales[i][0]), std::exp(s.log_scales[i][1]), std::exp(s.log_scales[i][2])});
      for (std::size_t a = 0; a < 3; ++a) {
        mean[a] += s.positions[i][a] / 152746.0;
        for (std::size_t b = 0; b < 3; ++b) sum[a][b] += c[a][b];
      }
    }
  for (std::size_t a = 0; a < 3; ++a) CHECK(std::abs(mean_a[a] - mean_b[a]) < 1e-4);
  CHECK(relative_difference(sum_a, sum_b) < 0.02);  // a wrong axis or sign gives 0.3 or more
}

TEST_CASE("formats: images of SOG that are larger than their splats need are rejected before they are read",
          "[formats]") {
  const TempFolder folder;
  write_sog(folder / "a.sog", random_splats(100, 1));
  const std::string file = get(folder / "a.sog");
  const ZipReader whole(std::as_bytes(std::span(file)), "a.sog");
  ZipWriter archive;
  std::filesystem::create_directories(folder / "plain");
  for (const std::string& member : whole.names()) {
    std::vector<std::byte> bytes = whole.get(member, SIZE_MAX);
    if (member != "meta.json") bytes.resize(8'000'000);  // these would be hundreds of MB in a compressed file
    archive.add(member, bytes);
    write_file_atomically(folder / "plain" / member, bytes);
  }
  write_file_atomically(folder / "b.sog", archive.finish());
  for (const char* name : {"b.sog", "plain/meta.json"})
    CHECK_THAT(message_of([&] { read_foreign_splats(folder / name); }),
               Contains("webp: 8000000 bytes are too many: at most "));
}

TEST_CASE("formats: streamed SOG lists every file once", "[formats]") {
  const TempFolder folder;
  write_sog(folder / "a.sog", random_splats(100, 1));
  const auto message = [&](const char* names) {
    put(folder / "lod-meta.json", fmt::format(R"({{"filenames": {}, "tree": {{"lods": {{"0":
        {{"file": 0, "offset": 0, "count": 100}}}}}}}})",
                                              names));
    return message_of([&] { read_foreign_splats(folder / "lod-meta.json"); });
  };
  CHECK(message(R"(["a.sog"])").empty());
  CHECK_THAT(message(R"(["a.sog", "a.sog"])"), Contains("lists a file twice"));
}

// With an earlier version, whose time was the product of the numbers of nodes and primitives, this took many
// minutes.
TEST_CASE("formats: glTF files with many nodes and primitives are read in linear time", "[formats]") {
  constexpr std::size_t kMany = 60'000;
  const TempFolder folder;
  write_glb(folder / "a.glb", random_splats(10, 0));
  const std::string glb = get(folder / "a.glb");
  std::uint32_t words = 0;
  std::memcpy(&words, &glb[12], sizeof words);
  const auto with_json = [&](const Json& json) {
    const std::string text = json.dump();
    const auto size = static_cast<std::uint32_t>(text.size());
    std::string changed = glb.substr(0, 12) + std::string(8, '\0') + text + glb.substr(20 + words);
    std::memcpy(&changed[12], &size, sizeof size);
    std::memcpy(&changed[16], &glb[16], 4);
    put(folder / "b.glb", changed);
    return message_of([&] { read_foreign_splats(folder / "b.glb"); });
  };
  Json json = parse_json(glb.substr(20, words), "a.glb");
  for (Json& accessor : json["accessors"]) accessor["count"] = 0;
  Json::array_t primitives(kMany, json["meshes"][0]["primitives"][0]);
  json["meshes"][0]["primitives"] = std::move(primitives);
  for (std::size_t i = 1; i < kMany; ++i) json["nodes"].push_back({{"translation", {0, 0, 0}}});
  CHECK_THAT(with_json(json), Contains("b.glb: the file has no splats"));
  json = parse_json(glb.substr(20, words), "a.glb");
  for (int i = 0; i < 1000; ++i) json[fmt::format("key{}", i)] = i;
  CHECK_THAT(with_json(json), Contains("at most 1000 are supported"));
}
