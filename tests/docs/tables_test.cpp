// SPDX-License-Identifier: Apache-2.0
// Tests that documents and interfaces list what the tables of the code contain: layouts, formats, camera
// models, variants and exit codes. The lists in documents are generated (generated_list.hpp).
#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/check/forms.hpp"
#include "host/dataset/lens.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/formats/other_programs.hpp"
#include "host/formats/splat_file.hpp"
#include "host/scene/model_variant.hpp"
#include "host/settings/fields.hpp"
#include "host/settings/train_settings.hpp"
#include "tests/support/generated_list.hpp"
#include "tests/support/variants.hpp"

namespace {

using ubs::test::backticks, ubs::test::check_list, ubs::test::table_head, ubs::test::table_row;
using Texts = std::vector<std::string>;

std::string source(const char* name) {
  return ubs::read_text_file(std::filesystem::path(UBS_SOURCE_DIR) / name);
}

// Returns the first group of every match of the pattern.
Texts found_in(const std::string& text, const char* pattern) {
  const std::regex regex(pattern);
  return {std::sregex_token_iterator(text.begin(), text.end(), regex, 1), std::sregex_token_iterator()};
}

std::set<std::string> set_of(const Texts& texts) { return {texts.begin(), texts.end()}; }

}  // namespace

TEST_CASE("tables: docs/data.md has the lists of layouts, other programs, camera models and formats",
          "[docs]") {
  std::string layouts = table_head({"layout", "data sets and programs", "recognised by"});
  for (const ubs::LayoutText& layout : ubs::layout_texts())
    layouts += table_row({backticks(layout.name), std::string(layout.title), std::string(layout.files)});
  check_list("docs/data.md", "layouts", layouts);

  using Content = ubs::OtherProgram::Content;
  std::string others = table_head({"program", "recognised by", "contains"});
  for (const ubs::OtherProgram& row : ubs::other_programs()) {
    std::string files = backticks(row.files);
    for (std::size_t at = 0; (at = files.find(' ', at)) != std::string::npos; at += 4)
      files.replace(at, 1, "`, `");
    if (!row.key.empty()) files += " with " + backticks(row.key);
    others += table_row({std::string(row.program), files,
                         row.content == Content::moments   ? "cameras of several moments"
                         : row.content == Content::cameras ? "cameras"
                         : row.content == Content::splats  ? "splats"
                                                           : "splat files: the last one is read"});
  }
  check_list("docs/data.md", "other programs", others);

  std::string lenses = table_head(
      {"number", "name", "parameters in COLMAP's order", "further parameters in `transforms.json`"});
  for (const ubs::LensModel& model : ubs::lens_models()) {
    std::string names(model.name), further;
    for (const std::string_view alias : ubs::words_of(model.json_aliases)) names += ", " + std::string(alias);
    const auto own = ubs::words_of(model.parameters);
    for (const std::string_view word : ubs::words_of(model.json_extra))
      if (std::ranges::count(own, word) == 0) further += (further.empty() ? "" : " ") + std::string(word);
    lenses += table_row({model.number < 0 ? "" : std::to_string(model.number), names,
                         std::string(model.parameters), further});
  }
  check_list("docs/data.md", "camera models", lenses);

  const Texts written = ubs::written_formats();
  std::string formats = table_head({"format", "extension", "contains", "written by", "offset", "antialiasing",
                                    "time samples", "losses when written"});
  for (const ubs::SplatFormat& format : ubs::splat_formats()) {
    const bool can_write = std::ranges::count(written, format.name) > 0;
    std::string losses = format.rounds ? "rounded" : "";
    if (can_write && format.degree < 3) losses += fmt::format(", harmonics above degree {}", format.degree);
    formats += table_row(
        {std::string(format.title),
         backticks(format.extension) +
             (format.second_extension.empty() ? "" : ", " + backticks(format.second_extension)),
         format.ours()                                   ? "models of `ubs`"
         : format.holds == ubs::SplatFormat::Holds::beta ? "Beta"
                                                         : "Gaussians",
         can_write ? backticks("--to " + std::string(format.name)) : "", format.keeps_offset ? "yes" : "",
         format.keeps_antialiasing ? "yes" : "", format.write_series ? "several" : "", losses});
  }
  check_list("docs/data.md", "formats", formats);
}

TEST_CASE("tables: docs/variants.md has the list of the settings of a variant", "[docs]") {
  std::string variants = table_head({"setting", "values", "meaning"});
  for (const ubs::VariantSwitch& row : ubs::kVariantSwitches) {
    const auto field = std::ranges::find(ubs::train_fields(), std::string_view(row.key),
                                         [](const auto& f) { return std::string_view(f.key); });
    REQUIRE(field != ubs::train_fields().end());
    std::string values;
    for (const std::string& value : found_in(field->choices, "([a-z0-9_]+)"))
      values += (values.empty() ? "" : ", ") + backticks(value);
    variants += table_row({backticks(row.key), values, field->help});
  }
  check_list("docs/variants.md", "the settings of a variant", variants);
}

TEST_CASE("tables: tests and device checks have a variant for every spatial kernel", "[docs]") {
  for (std::size_t i = 0; i < ubs::kSpatialKernels.size(); ++i) {
    INFO(ubs::kSpatialKernels[i].name);
    const auto has = [&](const auto& form) {
      return form.variant.kernel == static_cast<ubs::SpatialKernel>(i);
    };
    CHECK(std::ranges::any_of(ubs::test::named_variants(), has));
    CHECK(std::ranges::any_of(ubs::check::forms(), has));
  }
}

TEST_CASE("tables: the viewer of web pages knows the values of all switches of a variant", "[docs]") {
  const std::string worker = source("host/look/web/worker.js"), picture = source("host/look/web/picture.js");
  std::set<std::string> kernels;
  for (const ubs::SpatialKernelRow& row : ubs::kSpatialKernels) kernels.insert(row.name);
  const auto keys = [](const std::string& text, const std::string& table) {
    const std::size_t begin = text.find("const " + table + " = {");
    REQUIRE(begin != std::string::npos);
    return set_of(found_in(text.substr(begin, text.find("\n};", begin) - begin), "\n  ([a-z0-9_]+): \\{"));
  };
  CHECK(keys(worker, "KERNELS") == kernels);
  CHECK(keys(picture, "FALLOFFS") == kernels);
  for (const ubs::VariantSwitch& row : ubs::kVariantSwitches) {
    INFO(row.key);
    if (std::string_view(row.key) != "kernel")
      CHECK(worker.find(fmt::format("\n  {}: '{}'", row.key, row.values)) != std::string::npos);
  }
}

TEST_CASE("tables: the exit codes are the same in the header and in the Python package", "[docs]") {
  std::set<std::string> codes;
  for (const ubs::ExitCode& row : ubs::kExitCodes) codes.insert(std::to_string(row.code));
  CHECK(set_of(found_in(source("python/ubs/_errors.py"), "\n    ([0-9]+): [A-Z]")) == codes);
  codes.insert("0");
  CHECK(set_of(found_in(source("include/ubs/ubs.h"), "UBS_(?:OK|ERROR_[A-Z]+) = ([0-9]+)")) == codes);
}

TEST_CASE("tables: SECURITY.md has the list of the settings that a file of a run can set", "[docs]") {
  std::string run, model, user;
  for (const auto& field : ubs::train_fields()) {
    std::string& names = field.uses & ubs::kOfUser ? user : run;
    names += (names.empty() ? "" : ", ") + backticks(field.key);
    if (!(field.uses & ubs::kOfDrawing)) continue;
    CHECK_FALSE(field.uses & ubs::kOfUser);
    model += (model.empty() ? "" : ", ") + backticks(field.key);
  }
  check_list("SECURITY.md", "settings by who can set them",
             table_head({"settings", "can be set by"}) +
                 table_row({user, "only the command line, `--spec` and the functions of the library"}) +
                 table_row({run, "also `config.yaml`, `metrics.json` and checkpoints of a run"}) +
                 table_row({model, "also comments of a model file"}));
}

TEST_CASE("tables: a file of a run cannot set what only the user can set", "[docs]") {
  for (const auto& [key, value] :
       {std::pair{"cache_folder", "x"}, {"allow_outside", "true"}, {"seed", "7"}}) {
    ubs::TrainSettings settings;
    const auto fields = ubs::bind_fields(settings, ubs::train_fields());
    const auto field = std::ranges::find(fields, std::string_view(key), [](const auto& f) { return f.key; });
    REQUIRE(field != fields.end());
    const std::string before = ubs::field_text(*field);
    CHECK(ubs::set_field_from_run(fields, key, value, "file") == value);
    CHECK(ubs::field_text(*field) == ((field->uses & ubs::kOfUser) ? before : value));
    CHECK_THROWS_AS(ubs::set_field_from_run(fields, "seeds", "1", "file"), ubs::Error);
  }
}
