// SPDX-License-Identifier: Apache-2.0
// Tests OpenUSD files with splats. The tests read the numbers of written files with strtof(), read the many
// notations that the text format allows, and test series of time samples. tests/data/usd_test.py compares the
// files with OpenUSD itself.
#include <cstdlib>

#include "host/base/child_process.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/splat_file.hpp"
#include "host/formats/splat_series.hpp"
#include "tests/support/splats.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

// Returns the numbers between the first '[' after `attribute` (or after `sample`, if it is not empty) and the
// next ']'.
std::vector<float> numbers_of(const std::string& text, const std::string& attribute,
                              const std::string& sample = "") {
  std::size_t at = text.find(" " + attribute + (sample.empty() ? " = " : ".timeSamples = {"));
  INFO(attribute << " " << sample);
  REQUIRE(at != std::string::npos);
  if (!sample.empty()) at = text.find("\n        " + sample + ": [", at);
  REQUIRE(at != std::string::npos);
  at = text.find('[', text.find(sample.empty() ? '=' : ':', at));
  const std::size_t end = text.find(']', at);
  std::vector<float> numbers;
  for (const char* p = &text[at]; p < &text[end];) {
    char* next = nullptr;
    const float value = std::strtof(p, &next);
    if (next == p) {
      ++p;
      continue;
    }
    numbers.push_back(value);
    p = next;
  }
  return numbers;
}

// Returns the smallest layer with one splat of the schema. `more` is inserted into the prim.
std::string layer_of(const std::string& more, const std::string& metadata = "") {
  return "#usda 1.0\n" + metadata +
         "\ndef ParticleField3DGaussianSplat \"S\"\n{\n  point3f[] positions = [(1, 2, 3)]\n" + more + "}\n";
}

ImportedSplats parsed(const std::string& text, std::optional<double> time = {}) {
  return parse_usda(text, "t.usda", time);
}

std::string notes_of(const ImportedSplats& splats) {
  std::string all;
  for (const std::string& note : splats.report.notes) all += note + "\n";
  return all;
}

std::string refusal_of(const std::string& text) {
  return message_of([&] { parsed(text); });
}

}  // namespace

TEST_CASE("usd: the text contains every number, rotated so that y points up", "[formats]") {
  const TempFolder folder;
  for (const int degree : {0, 1, 2, 3}) {
    ImportedSplats splats = random_splats(40, degree);
    splats.positions[3] = {1e-42f, -3.4e38f, 16777217.0f};  // a denormal, and nearly the largest float
    splats.offset = {4321987.0625, -2.5, 7};
    write_usda(folder / "a.usda", splats);
    const std::string text = get(folder / "a.usda");
    CHECK(text.starts_with("#usda 1.0\n"));
    for (const char* part :
         {"def ParticleField3DGaussianSplat \"Splats\"", "upAxis = \"Y\"", "metersPerUnit = 1",
          "defaultPrim = \"Splats\"", "double3 xformOp:translate = (4321987.0625, 2.5, -7)",
          "uniform token[] xformOpOrder = [\"xformOp:translate\"]"})
      CHECK_THAT(text, Contains(part));
    CHECK(text.find("timeSamples") == std::string::npos);
    CHECK_THAT(text, Contains(fmt::format("uniform int radiance:sphericalHarmonicsDegree = {}\n", degree)));
    const auto places = numbers_of(text, "positions"), turns = numbers_of(text, "orientations"),
               scales = numbers_of(text, "scales"), opacities = numbers_of(text, "opacities"),
               colours = numbers_of(text, "radiance:sphericalHarmonicsCoefficients"),
               extent = numbers_of(text, "extent");
    REQUIRE(places.size() == 120);
    REQUIRE(turns.size() == 160);
    REQUIRE(scales.size() == 120);
    REQUIRE(opacities.size() == 40);
    REQUIRE(colours.size() == splats.sh.size());
    REQUIRE(extent.size() == 6);
    for (std::size_t i = 0; i < 40; ++i) {
      const auto& p = splats.positions[i];
      const auto& q = splats.rotations[i];
      CHECK((places[3 * i] == p[0] && places[3 * i + 1] == -p[1] && places[3 * i + 2] == -p[2]));
      // The half turn about x is the quaternion (0, 1, 0, 0). It changes the axes, so it is multiplied from
      // both sides.
      CHECK((turns[4 * i] == q[0] && turns[4 * i + 1] == q[1] && turns[4 * i + 2] == -q[2] &&
             turns[4 * i + 3] == -q[3]));
      for (std::size_t k = 0; k < 3; ++k)
        CHECK(scales[3 * i + k] == Approx(std::exp(splats.log_scales[i][k])).epsilon(3e-7));
      CHECK(opacities[i] == Approx(1 / (1 + std::exp(-splats.opacity_logits[i]))).epsilon(3e-7));
      // The extent includes three standard deviations.
      if (i == 3) continue;
      const auto c = covariance_of({q[0], q[1], q[2], q[3]},
                                   {std::exp(splats.log_scales[i][0]), std::exp(splats.log_scales[i][1]),
                                    std::exp(splats.log_scales[i][2])});
      for (std::size_t k = 0; k < 3; ++k) {
        CHECK(extent[k] <= places[3 * i + k] - 3 * std::sqrt(c[k][k]));
        CHECK(extent[3 + k] >= places[3 * i + k] + 3 * std::sqrt(c[k][k]));
      }
    }
    for (std::size_t k = 0; k < colours.size(); ++k) CHECK(std::abs(colours[k]) == std::abs(splats.sh[k]));

    CHECK(detect_splat_format(folder / "a.usda").name == "usda");
    const ImportedSplats back = read_foreign_splats(folder / "a.usda");
    CHECK(back.positions == splats.positions);
    CHECK(back.sh == splats.sh);
    CHECK(back.offset == splats.offset);
    CHECK(back.report.notes.empty());
    splats.positions[3] = {};
    ImportedSplats near = back;
    near.positions[3] = {};
    const Differences d = compare(splats, near);
    CHECK(d.rotation < 1e-6);
    CHECK(d.log_scale < 2e-6);  // exp and log in float32
    CHECK(d.opacity < 2e-7);
  }
  CHECK(load_splat_model(folder / "a.usda").comments ==
        std::vector<std::string>{"ubs_up 0 -1 0", "ubs_offset 4321987.0625 -2.5 7"});
}

TEST_CASE("usd: values that cannot be written are rejected or reported", "[formats]") {
  const TempFolder folder;
  ImportedSplats splats = random_splats(5, 1);
  splats.sh[17] = std::numeric_limits<float>::quiet_NaN();
  CHECK_THAT(message_of([&] { write_usda(folder / "a.usda", splats); }),
             Contains("splat 1 has a value that is not finite"));
  CHECK_THAT(message_of([&] { write_usda(folder / "a.usda", ImportedSplats()); }),
             Contains("no splats to write"));
  CHECK(!std::filesystem::exists(folder / "a.usda"));
  CHECK_THAT(format_remarks(splat_format("usda"), random_splats(2, 4)).at(0),
             Contains("degree 4 to 4 are lost"));
  splats = random_splats(2, 0);
  splats.antialiased = true;
  CHECK_THAT(format_remarks(splat_format("usda"), splats).at(0), Contains("antialiasing"));
  for (const char* name : {"a.usda", "A.USDA"}) CHECK(format_of_extension(name)->name == "usda");
  for (const char* name : {"a.usdc", "a.usd"}) CHECK(format_of_extension(name)->name == "usdc");
  CHECK(format_of_extension("a") == nullptr);
}

TEST_CASE("usd: a series contains time samples of changing values", "[formats]") {
  const TempFolder folder;
  std::vector<ImportedSplats> moments(3, random_splats(20, 1));
  for (std::size_t m = 0; m < 3; ++m)
    for (auto& p : moments[m].positions) p[1] += static_cast<float>(m);
  write_usda_series(folder / "a.usda", SplatSeries(moments));
  const std::string text = get(folder / "a.usda");
  for (const char* part : {"startTimeCode = 0\n", "endTimeCode = 2\n", "timeCodesPerSecond = 24\n"})
    CHECK_THAT(text, Contains(part));
  for (const char* same : {"orientations = [", "scales = [", "opacities = [", "Coefficients = ["})
    CHECK_THAT(text, Contains(same));
  // Readers that ignore time find the first time sample as the default value.
  const std::vector<float> places_at_first = numbers_of(text, "positions", "0");
  CHECK(numbers_of(text, "positions") == places_at_first);
  CHECK(numbers_of(text, "extent") == numbers_of(text, "extent", "0"));
  for (std::size_t m = 0; m < 3; ++m) {
    const std::vector<float> places = numbers_of(text, "positions", fmt::format("{}", m));
    const std::vector<float> extent = numbers_of(text, "extent", fmt::format("{}", m));
    REQUIRE(places.size() == 60);
    REQUIRE(extent.size() == 6);
    for (std::size_t i = 0; i < 20; ++i) {
      CHECK(places[3 * i + 1] == -moments[m].positions[i][1]);
      CHECK((extent[1] < places[3 * i + 1] && places[3 * i + 1] < extent[4]));
    }
  }
  const ImportedSplats first = read_foreign_splats(folder / "a.usda");
  CHECK(first.positions == moments[0].positions);
  CHECK_THAT(notes_of(first),
             Contains("3 time samples, time codes 0 to 2: the sample at 0 is read; 'ubs convert --time'"));
  for (const auto& [time, moment] : {std::pair{0.0, 0}, {0.3, 1}, {0.6, 1}, {1.0, 2}}) {
    const ImportedSplats read = read_foreign_splats(folder / "a.usda", time);
    CHECK(read.positions == moments[static_cast<std::size_t>(moment)].positions);
    CHECK(read.sh == moments[0].sh);
    CHECK_THAT(notes_of(read), Contains(fmt::format("{} is read\n", moment)));
  }
  write_usda(folder / "s.usda", moments[0]);
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "s.usda", 0.5); }, ErrorKind::usage),
             Contains("requires a file with time"));
  write_spz(folder / "s.spz", moments[0]);
  CHECK_THAT(message_of([&] { read_foreign_splats(folder / "s.spz", 0.5); }, ErrorKind::usage),
             Contains("no time samples to choose"));
  CHECK_THAT(message_of([&] { load_splat_model(folder / "s.spz", 0.5); }, ErrorKind::usage),
             Contains("no time samples to choose"));

  // Harmonics and the number of splats change.
  for (float& v : moments[1].sh) v *= 0.5f;
  moments[2] = part_of(moments[2], 0, 7);
  write_usda_series(folder / "b.usda", SplatSeries(moments));
  for (std::size_t m = 0; m < 3; ++m) {
    const ImportedSplats read = read_foreign_splats(folder / "b.usda", static_cast<double>(m) / 2);
    CHECK(read.sh == moments[m].sh);
    CHECK(read.positions == moments[m].positions);
  }
}

TEST_CASE("usd: time samples of a series are prepared for interpolation", "[formats]") {
  const ImportedSplats base = random_splats(6, 0);
  std::vector<ImportedSplats> moments(4, base);
  const float hidden = -16;
  for (std::size_t m = 0; m < 4; ++m) {
    moments[m].opacity_logits[0] = hidden;  // never visible
    if (m != 1) {  // splat 1 is only visible at time sample 1, so its other positions do not matter
      moments[m].opacity_logits[1] = hidden;
      moments[m].positions[1] = {0, 0, 0};
    }
  }
  for (float& q : moments[1].rotations[2]) q = -q;
  // This is the same ellipsoid, but a quarter turn about z exchanges its x and y axes.
  const auto [w, x, y, z] = base.rotations[3];
  const float h = std::sqrt(0.5f);
  moments[2].rotations[3] = {h * (w - z), h * (x + y), h * (y - x), h * (z + w)};
  std::swap(moments[2].log_scales[3][0], moments[2].log_scales[3][1]);
  SplatSeries series(moments);
  REQUIRE(series.finish(1.0f / 255));
  REQUIRE(series.size() == 4);
  for (std::size_t m = 0; m < 4; ++m) {
    const ImportedSplats& s = series.moments()[m];
    REQUIRE(s.count() == 5);
    CHECK(series.sh(m) == std::vector<float>(base.sh.begin() + 3, base.sh.end()));
    CHECK(s.positions[0] == base.positions[1]);
    CHECK(s.opacity_logits[0] == (m == 1 ? base.opacity_logits[1] : hidden));
    for (std::size_t i = 0; i < 5; ++i)
      for (std::size_t k = 0; k < 4; ++k)
        CHECK(s.rotations[i][k] == Approx(base.rotations[i + 1][k]).margin(1e-6));
    CHECK(s.log_scales[2] == base.log_scales[3]);
  }

  // If the numbers of splats differ, nothing is prepared for interpolation. If consecutive time samples have
  // the same number of splats, keep_apart() then changes one of these numbers, so that readers do not
  // interpolate between the samples.
  moments[3] = part_of(base, 0, 5);
  SplatSeries apart(moments);
  CHECK(!apart.finish(0.5f));
  CHECK(apart.moments()[0].count() == 6);
  apart.keep_apart();
  for (std::size_t m = 1; m < 4; ++m) CHECK(apart.moments()[m].count() != apart.moments()[m - 1].count());
  CHECK(apart.moments()[1].opacity_logits.back() == -kMaxLogit);
  CHECK(apart.sh(1).size() == 3 * apart.moments()[1].count());
}

TEST_CASE("usd: text is read in many notations that the format allows", "[formats]") {
  const ImportedSplats plain = parsed(layer_of(""));
  REQUIRE(plain.count() == 1);
  CHECK(plain.positions[0] == std::array<float, 3>{1, -2, -3});
  // The defaults of the schema are: no rotation, scale 1, opaque, grey.
  CHECK(plain.rotations[0] == std::array<float, 4>{1, 0, 0, 0});
  CHECK(plain.log_scales[0] == std::array<float, 3>{0, 0, 0});
  CHECK(plain.opacity_logits[0] == kMaxLogit);
  CHECK(plain.sh == std::vector<float>(3, 0.0f));
  CHECK_THAT(notes_of(plain),
             Contains("scales are missing: the schema's default") && Contains("opacities are missing"));

  const std::string odd = R"usd(#usda 1.0
(
    "a comment with } and #"
    doc = """lines
with "quotes" and )"""
    customLayerData = { dictionary d = { string a = ")}" ; int[] b = [1, 2] } }
    upAxis = "Y"; metersPerUnit = 1
)
# comment
def Xform "World" ( kind = "group" prepend apiSchemas = ["A"] )
{
    double3 xformOp:translate:a = (10, 20, 30)
    float3 xformOp:scale = (1, 1, 1)
    quatf xformOp:orient = (-1, 0, 0, 0)
    float xformOp:rotateX = 0
    double3 xformOp:translate:pivot = (1, 1, 1)
    matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0.5, 0, 0, 1) )
    uniform token[] xformOpOrder = ["xformOp:translate:a", "xformOp:translate:pivot", "xformOp:rotateX",
        "xformOp:orient", "xformOp:scale", "xformOp:transform", "!invert!xformOp:translate:pivot"]
    reorder nameChildren = ["A", "S"]
    def Mesh "M" { int[] faceVertexCounts = [3] (doc = "]") }
    class "C" { }
    over "O" { }
    def ParticleField3DGaussianSplat "Off" ( active = false ) { point3f[] positions = [(9, 9, 9)] }
    def ParticleField3DGaussianSplat "S" (
        assetInfo = { asset identifier = @a [b].usd@ }
    )
    {
        rel proxyPrim = </World/M>
        prepend rel material = [</a>, </b>]
        custom uniform string note = 'it\'s } here'
        float3[] extent.connect = </World.x>
        /* half forms only */
        point3h[] positionsh = [ (1, 2, 3), (4,5,6) , ] ( interpolation = "vertex" )
        quath[]orientationsh=[(0,1,0,0),(0.5,0.5,0.5,0.5)]
        half3[] scalesh.timeSamples = {
            0.5: [(1, 2, 3), (1, 1, 1)],   # comment
            -2 : None,
            3: [(2, 2, 2), (4, 4, 4)]
        }
        half[] opacitiesh = [0.5, 0.560547]
        uniform int radiance:sphericalHarmonicsDegree = 1
        half3[] radiance:sphericalHarmonicsCoefficientsh = [(1,0,0), (0,1,0), (0,2,0), (0,3,0),
            (2,0,0), (0,4,0), (0,5,0), (0,6,0)]
    }
}
)usd";
  const ImportedSplats s = parsed(odd, 1.0);
  REQUIRE(s.count() == 2);
  CHECK(s.offset == std::array<double, 3>{10.5, -20, -30});
  CHECK(s.positions[1] == std::array<float, 3>{4, -5, -6});
  CHECK(s.rotations[1] == std::array<float, 4>{0.5, 0.5, -0.5, -0.5});
  CHECK(s.log_scales[1][0] == std::log(4.0f));
  // OpenUSD prints half-precision numbers with six digits. The exact value is 574 / 1024.
  CHECK(s.opacity_logits[1] == logit_of(574.0 / 1024));
  CHECK(s.sh_degree == 1);
  // The coefficients of degree 1 correspond to y, z, x, so the first two change their sign.
  CHECK(s.sh[3 + 1] == -1);
  CHECK(s.sh[6 + 1] == -2);
  CHECK(s.sh[9 + 1] == 3);
  CHECK_THAT(notes_of(s), Contains("material, note, proxyPrim") && Contains("time codes -2 to 3"));
  CHECK(parsed(odd, 0.5).log_scales[0][1] == std::log(2.0f));
  CHECK(parsed(odd).log_scales[0][1] == 0);  // the first sample is None

  const ImportedSplats up = parsed(layer_of("", "(\n upAxis = \"Z\"\n metersPerUnit = 0.01\n)"));
  CHECK(up.positions[0] == std::array<float, 3>{1, 2, 3});
  CHECK_THAT(notes_of(up), Contains("z axis points up") && Contains("the unit of length is 0.01 m"));
  // Two prims in different places are joined.
  const std::string two = layer_of("") + R"usd(
def ParticleField3DGaussianSplat "T" { point3f[] positions = [(1, 1, 1)]
  float[] opacities = [0.5, 0.5]
  float3 xformOp:translate = (10, 0, 0)
  uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"] })usd";
  const ImportedSplats joined = parsed(two);
  REQUIRE(joined.count() == 2);
  CHECK(joined.positions[1] == std::array<float, 3>{11, -1, -1});
  CHECK_THAT(notes_of(joined), Contains("T: opacities has more values"));
}

TEST_CASE("usd: the operations of the hierarchy rotate, scale and distort splats with their colours",
          "[formats]") {
  const TempFolder folder;
  const ImportedSplats splats = random_splats(30, 3);
  write_usda(folder / "a.usda", splats);
  const std::string text = get(folder / "a.usda");
  // Returns the splats of a prim with these operations, below prims with other operations.
  const auto with = [&](const std::string& own, const std::string& above = "", const std::string& top = "",
                        const std::string& axis = "Y") {
    std::string prim = text.substr(text.find("def "));
    prim.insert(prim.rfind('}'), own);
    return parsed("#usda 1.0\n( upAxis = \"" + axis + "\" )\ndef Xform \"T\" {\n" + top +
                  "def Xform \"A\" {\n" + above + prim + "}\n}\n");
  };
  const auto list = [](const std::string& names) {
    return "uniform token[] xformOpOrder = [" + names + "]\n";
  };
  const auto one = [&](const std::string& type, const std::string& name, const std::string& value) {
    return type + " xformOp:" + name + " = " + value + "\n" + list("\"xformOp:" + name + "\"");
  };
  const double h = std::sqrt(0.5);
  const Mat3 about_x = turn_matrix({h, h, 0, 0}), about_y = turn_matrix({h, 0, h, 0}),
             about_z = turn_matrix({h, 0, 0, h});
  const auto times = [](const Mat3& a, const Mat3& b) {
    Mat3 c{};
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        for (std::size_t k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
    return c;
  };
  const auto check = [&](const ImportedSplats& back, const Mat3& m, const Vec3& move, bool similar = true) {
    CHECK(check_transformed(splats, back, m, move, similar) < 3e-6);
    CHECK(contains(notes_of(back), "only rotated") == !similar);
  };
  check(with(one("float", "rotateX", "90")), about_x, {0, 0, 0});
  check(with(one("float", "rotateY:a", "90")), about_y, {0, 0, 0});
  check(with(one("double", "rotateZ", "450")), about_z, {0, 0, 0});
  check(with(one("float3", "rotateXYZ", "(90, 90, 0)")), times(about_y, about_x), {0, 0, 0});
  check(with(one("float3", "rotateZXY", "(90, 90, 90)")), times(about_y, times(about_x, about_z)), {0, 0, 0});
  check(with(one("quatf", "orient", "(2, -0.5, 1, 0.25)")), turn_matrix({2, -0.5, 1, 0.25}), {0, 0, 0});
  check(with(one("float3", "scale", "(3, 3, 3)")), turn_matrix({1, 0, 0, 0}, 3), {0, 0, 0});
  check(with(one("float3", "scale", "(1, 1, -1)")), Mat3{{{1, 0, 0}, {0, 1, 0}, {0, 0, -1}}}, {0, 0, 0});
  check(with(one("double", "scaleY", "2")), Mat3{{{1, 0, 0}, {0, 2, 0}, {0, 0, 1}}}, {0, 0, 0}, false);
  check(with(one("double", "translateZ", "7")), turn_matrix({1, 0, 0, 0}), {0, 0, 7});
  // The rows of a matrix are the images of the axes. This is a quarter turn about z.
  check(with(one("matrix4d", "transform", "((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (4, 5, 6, 1))")),
        about_z, {4, 5, 6});
  // The last operation of the list is applied first; that of the prims above is applied last.
  const std::string two = "double3 xformOp:translate = (1, 2, 3)\nfloat xformOp:rotateZ = 90\n";
  check(with(two + list("\"xformOp:translate\", \"xformOp:rotateZ\"")), about_z, {1, 2, 3});
  check(with(two + list("\"xformOp:rotateZ\", \"xformOp:translate\"")), about_z, {-2, 1, 3});
  check(with(two + list("\"!invert!xformOp:rotateZ\", \"xformOp:translate\"")), turn_matrix({h, 0, 0, -h}),
        {2, -1, 3});
  check(with(one("double3", "translate", "(1, 2, 3)"), one("float", "rotateZ", "90"),
             one("float3", "scale", "(2, 2, 2)")),
        turn_matrix({h, 0, 0, h}, 2), {-4, 2, 6});
  check(with("float xformOp:rotateX = 90\n" + list("\"!resetXformStack!\", \"xformOp:rotateX\""),
             one("float3", "scale", "(9, 9, 9)")),
        about_x, {0, 0, 0});
  // With z up, the axes are not converted.
  const ImportedSplats plain = with("", "", "", "Z");
  CHECK(check_transformed(plain, with(one("float", "rotateX", "90"), "", "", "Z"), about_x, {0, 0, 0}, true,
                          false) < 3e-6);
}

TEST_CASE("usd: errors describe what cannot be read", "[formats]") {
  const auto with = [](const std::string& more) { return refusal_of(layer_of(more)); };
  const std::string op = "  uniform token[] xformOpOrder = [\"xformOp:";
  CHECK_THAT(with("  float3 xformOp:scale = (1, 0, 1)\n" + op + "scale\"]\n"),
             Contains("t.usda: the prim S has the operation xformOp:scale: it has no inverse"));
  CHECK_THAT(with("  float xformOp:rotateX = nan\n" + op + "rotateX\"]\n"),
             Contains("xformOp:rotateX: its value is not a finite transformation"));
  CHECK_THAT(with("  quatf xformOp:orient = (0, 0, 0, 0)\n" + op + "orient\"]\n"), Contains("not a finite"));
  CHECK_THAT(with("  float2 xformOp:rotateXY = (1, 2)\n" + op + "rotateXY\"]\n"),
             Contains("xformOp:rotateXY: it is not supported"));
  CHECK_THAT(
      with("  matrix4d xformOp:transform = ((1, 0, 0, 1), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))\n" + op +
           "transform\"]\n"),
      Contains("xformOp:transform: it is not supported"));
  CHECK_THAT(refusal_of("#usda 1.0\ndef PointInstancer \"I\" {\n" + layer_of("").substr(10) + "}\n"),
             Contains("the prim S belongs to the PointInstancer I, which is not supported"));
  CHECK(with("  float xformOp:rotateX = 90\n").empty());  // xformOpOrder does not list this operation
  CHECK_THAT(with("  float3[] scales = [(-1, -2, -3)]\n"),
             Contains("linear scales (the file may contain logarithms)"));
  CHECK_THAT(with("  float[] opacities = [3]\n"), Contains("from 0 to 1 (the file may contain logits)"));
  CHECK_THAT(with("  float[] opacities = [x]\n"), Contains("t.usda, line 6: 'x' is not a number"));
  CHECK_THAT(with("  float3[] scales = [(1, 2)]\n"), Contains("expected ',', found ')"));
  CHECK_THAT(with("  uniform int radiance:sphericalHarmonicsDegree = 99\n"),
             Contains("degree of the harmonics"));
  CHECK_THAT(with("  float[] opacities.timeSamples = { a: [1] }\n"), Contains("'a' is not a time code"));
  CHECK_THAT(message_of([] { parsed(layer_of(""), 0.5); }, ErrorKind::usage),
             Contains("--time requires a file with time samples"));
  CHECK_THAT(refusal_of("#usda 1.0\ndef Xform \"X\" ( references = @s.usdc@</S> (offset = 1) ) { }"),
             Contains("1 prims, none of the type") && Contains("usdcat --flatten"));
  CHECK_THAT(refusal_of("#usda 1.0\n"), Contains("has no splats"));
  CHECK_THAT(refusal_of("#usdb"), Contains("not a USD text file"));
  std::string deep = "#usda 1.0\n";
  for (int i = 0; i < 100000; ++i) deep += "def \"a\" {";
  CHECK_THAT(refusal_of(deep), Contains("nested deeper than"));
  // A file that is truncated anywhere is an error, unless only text after the last bracket is missing.
  const std::string whole =
      layer_of("  float[] opacities.timeSamples = { 0: [0.5], }\n", "( doc = '''x''' )");
  for (std::size_t size = 6; size + 2 < whole.size(); ++size) {
    INFO(size);
    CHECK(!refusal_of(whole.substr(0, size)).empty());
  }
}

TEST_CASE("usd: OpenUSD converts the binary form; without OpenUSD, the error suggests .usda", "[formats]") {
  const TempFolder folder;
  const std::string before = std::getenv("PATH") ? std::getenv("PATH") : "";
  setenv("PATH", folder.path().c_str(), 1);
  const std::string message =
      message_of([&] { write_usdc(folder / "a.usdc", random_splats(2, 0)); }, ErrorKind::usage);
  put(folder / "b.usdc", "PXR-USDC and more");
  CHECK(detect_splat_format(folder / "b.usdc").name == "usdc");
  const std::string reading = message_of([&] { read_foreign_splats(folder / "b.usdc"); }, ErrorKind::usage);
  // Tests a usdcat that works, and a usdcat that fails.
  put(folder / "usdcat", "#!/bin/sh\nif [ $# = 3 ]; then read line < $1; echo \"$line\" > $3; fi\n");
  std::filesystem::permissions(folder / "usdcat", std::filesystem::perms::owner_all);
  write_usdc(folder / "c.usdc", random_splats(2, 0));
  put(folder / "usdcat", "#!/bin/sh\nif [ $# = 3 ]; then echo no such plugin; exit 4; fi\n");
  const std::string failing = message_of([&] { write_usdc(folder / "d.usdc", random_splats(2, 0)); });
  setenv("PATH", before.c_str(), 1);
  CHECK_THAT(message,
             Contains("a.usdc requires OpenUSD") && Contains("pip install usd-core") && Contains(".usda"));
  CHECK_THAT(reading, Contains("b.usdc: reading a binary USD file requires OpenUSD"));
  CHECK(get(folder / "c.usdc") == "#usda 1.0\n");
  CHECK_THAT(failing, Contains("code 4: no such plugin"));
  CHECK(!std::filesystem::exists(folder / "d.usdc"));
}
