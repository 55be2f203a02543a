// SPDX-License-Identifier: Apache-2.0
// Tests how the host represents a variant: the rows and names of parameters, the record in a model file, the
// settings, and the initial parameters.
#include <cmath>
#include <set>

#include "host/formats/ply.hpp"
#include "host/scene/initialise.hpp"
#include "host/settings/fields.hpp"
#include "host/settings/train_settings.hpp"
#include "tests/support/temp_folder.hpp"
#include "tests/support/variants.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

SplatModel numbered_model(int dim, const ModelVariant& variant) {
  SplatModel model(dim, 5, variant);
  for (std::size_t i = 0; i < model.values.size(); ++i) model.values[i] = 0.5f * static_cast<float>(i) - 3;
  return model;
}

NamedVariant named(const std::string& name) {
  for (const NamedVariant& v : named_variants())
    if (v.name == name) return v;
  FAIL("named_variants() contains no variant with the name " << name);
  return {};
}

}  // namespace

TEST_CASE("variants: the number of parameter rows equals that of the published methods", "[variants]") {
  const auto count = [](const std::string& name) {
    const NamedVariant v = named(name);
    return ParameterLayout(v.dim, v.variant).count;
  };
  CHECK(count("3DGS") == 59);  // method.md 7.4
  CHECK(count("6DGS") == 76);
  CHECK(count("7DGS") == 84);
  CHECK(ParameterLayout(3, named("3DGS").variant).property_names()[5] == "f_dc_2");
  CHECK(ParameterLayout(3, named("3DGS").variant).property_names().back() == "rot_3");
  const auto names = ParameterLayout(6, {.kernel = SpatialKernel::gaussian}).property_names();
  CHECK(names[7] == "beta_1");  // without the spatial beta_0, numbers start at 1
}

TEST_CASE("variants: each parameter row belongs to exactly one group", "[variants]") {
  for (const NamedVariant& v : named_variants()) {
    INFO(v.name);
    const ParameterLayout layout(v.dim, v.variant);
    int next = 0;
    for (const ParameterGroup& group : parameter_groups(layout)) {
      CHECK(group.first == next);
      next += group.count;
    }
    CHECK(next == layout.count);
    const auto names = layout.property_names();
    CHECK(std::set<std::string>(names.begin(), names.end()).size() == static_cast<std::size_t>(layout.count));
  }
}

TEST_CASE("variants: the decoder in web pages has the same switches and values", "[variants]") {
  const std::string worker = get(UBS_SOURCE_DIR "/host/look/web/worker.js");
  for (const VariantSwitch& s : kVariantSwitches)
    if (s.key != std::string_view("kernel"))  // tests/docs/tables_test.cpp compares its tables
      CHECK_THAT(worker, Contains(fmt::format("\n  {}: '{}'", s.key, s.values)));
}

TEST_CASE("variants: a model file stores its variant", "[variants][ply]") {
  const TempFolder folder;
  for (const NamedVariant& v : named_variants()) {
    INFO(v.name << ", N = " << v.dim);
    const SplatModel model = numbered_model(v.dim, v.variant);
    const std::vector<std::string> comments{"made by a test"};
    write_splat_ply(folder / "a.ply", model, comments);
    std::vector<std::string> others;
    const SplatModel back = read_splat_ply(folder / "a.ply", &others);
    CHECK(back.variant == v.variant);
    CHECK(back.dim == v.dim);
    CHECK(back.values == model.values);
    CHECK(others == comments);
    for (const auto& [key, value] : non_default_switches(v.variant))
      CHECK_THAT(get(folder / "a.ply"), Contains("comment ubs " + key + " " + value + "\n"));
  }
  write_splat_ply(folder / "default.ply", numbered_model(6, ModelVariant{}));
  CHECK_THAT(get(folder / "default.ply"), !Contains("comment"));
}

TEST_CASE("variants: unsupported records are rejected, and similar comments are not taken for records",
          "[variants][ply]") {
  const TempFolder folder;
  write_splat_ply(folder / "good.ply", numbered_model(6, {.cov_mode = CovMode::whiten}));
  const std::string good = get(folder / "good.ply");
  const auto refusal = [&](const std::string& line) {
    put(folder / "bad.ply", replaced(good, "comment ubs cov_mode whiten\n", line));
    return message_of([&] { read_splat_ply(folder / "bad.ply"); });
  };
  CHECK_THAT(refusal("comment ubs cov_mode sym\n"),
             Contains("'sym' is not a value of cov_mode: expected one of upper|whiten"));
  CHECK_THAT(refusal("comment ubs fog on\n"), Contains("unknown setting 'fog'"));
  CHECK_THAT(refusal("comment ubs cov_mode\n"), Contains("is not 'ubs <key> <value>'"));
  CHECK_THAT(refusal("comment ubs cov_mode whiten\ncomment ubs cov_mode whiten\n"),
             Contains("a second time"));
  CHECK_THAT(refusal("comment ubs rot_mode quaternion\n"), Contains("needs dim = 3"));
  CHECK_THAT(refusal("comment ubs kernel gaussian\n"), Contains("beta_* properties"));
  CHECK_THAT(refusal("comment ubs colour sh1\n"), Contains("'f_dc_0' is missing"));
  CHECK_THAT(refusal("comment ubs  \n"), Contains("is not 'ubs <key> <value>'"));
  put(folder / "fine.ply", replaced(good, "comment ubs cov_mode whiten\n", "comment ubstantial\n"));
  CHECK(read_splat_ply(folder / "fine.ply").variant == ModelVariant{});
}

TEST_CASE("variants: every value of every switch can be set and saved, and invalid values are rejected",
          "[variants][settings]") {
  TrainSettings settings;
  settings.dim = 3;
  const auto fields = bind_fields(settings, train_fields());
  for (const VariantSwitch& s : kVariantSwitches) {
    std::string values = s.values;
    int number = 0;
    while (!values.empty()) {
      const std::string value = values.substr(0, values.find('|'));
      values.erase(0, value.size() + 1);
      settings = TrainSettings{};
      settings.dim = 3;
      set_field(fields, s.key, value, "test");
      const ModelVariant variant = settings.variant;
      ModelVariant expected;
      set_switch(expected, s.key, value, "test");
      CHECK(variant == expected);
      CHECK(non_default_switches(variant).size() == (number > 0 ? 1 : 0));
      ++number;
      CHECK_NOTHROW(validate(settings));
      const TempFolder folder;
      put(folder / "config.yaml", to_yaml(fields));
      TrainSettings again;
      load_yaml(bind_fields(again, train_fields()), folder / "config.yaml");
      CHECK(again.variant == variant);
    }
    CHECK_THROWS_WITH(set_field(fields, s.key, "nonsense", "test"), Contains(s.key));
  }
  settings.dim = 6;
  settings.variant = {};
  settings.variant.rot_mode = RotMode::quaternion;
  CHECK_THAT(message_of([&] { validate(settings); }, ErrorKind::usage), Contains("needs dim = 3"));
  settings.variant.rot_mode = RotMode::exp;
  settings.variant.cov_param = CovParam::skew_nd;
  CHECK_THAT(message_of([&] { validate(settings); }, ErrorKind::usage), Contains("spatial_ortho"));
}

TEST_CASE("variants: initial parameters have the documented values", "[variants][initialise]") {
  for (const NamedVariant& v : named_variants()) {
    INFO(v.name);
    InitOptions options;
    options.variant = v.variant;
    options.beta_query = 0.25;
    const SplatModel model = initialise_random(v.dim, 40, 1, options);
    CHECK(model.variant == v.variant);
    const ParameterLayout layout = model.layout();
    for (const float x : model.values) REQUIRE(std::isfinite(x));
    if (v.variant.has_spatial_beta()) CHECK(model.row(layout.beta)[3] == 0.0f);
    if (v.variant.has_query_beta() && v.dim == 7) CHECK(model.row(layout.query_beta + 3)[0] == 0.25f);
    const float colour = model.row(layout.rgb)[0];
    if (v.variant.harmonics())
      CHECK(0.28209479177387814 * colour + 0.5 == Approx(127 / 255.0).epsilon(1e-6));
    else
      CHECK(colour == Approx(127 / 255.0));
    const int lobes = v.variant.lobes(), angles = layout.rgb + 3 + 3 * lobes;
    for (int row = layout.rgb + 3; row < layout.opacity; ++row) {
      const bool angle = row >= angles && row < angles + 2 * lobes;
      CHECK((model.row(row)[0] == 0) != angle);
      CHECK(std::abs(model.row(row)[0]) <= 3.1416f);
    }
    const bool quaternion = v.variant.rot_mode == RotMode::quaternion;
    for (int row = layout.l_triangle; row < layout.count; ++row)
      CHECK(model.row(row)[7] == Approx(quaternion && row == layout.l_triangle ? 1 : 0).margin(1e-3));
  }
  // Two variants with the same kinds of parameters start with equal values.
  InitOptions options;
  options.variant.cov_param = CovParam::cholesky;
  CHECK(initialise_random(6, 30, 4, options).values == initialise_random(6, 30, 4).values);
}
