// SPDX-License-Identifier: Apache-2.0
// Experiments as files: all that are in data_specs load and plan, and what is wrong is named with its place.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/base/file.hpp"
#include "host/experiment/plan.hpp"
#include "tests/experiment/made_up.hpp"

namespace ubs::experiment {
namespace {

namespace fs = std::filesystem;
using test::contains;
using test::message_of;
using test::put;
using test::TempFolder;

const fs::path kSpecs = fs::path(UBS_SOURCE_DIR) / "data_specs";

int no_width(const fs::path&, const TrainSettings&) { return 800; }

// Runs of a file as docs/experiments.md states them; 0 where it does not.
std::size_t stated_runs(const std::string& file) {
  const std::string page = read_text_file(kSpecs.parent_path() / "docs/experiments.md"),
                    name = "`" + file + "` (";
  const std::size_t at = page.find(name);
  return at == page.npos ? 0 : std::stoul(page.substr(at + name.size()));
}

TEST_CASE("data_specs: every data set and every experiment loads and plans", "[experiment]") {
  std::size_t sets = 0, experiments = 0, papers = 0, published = 0;
  for (const auto& entry : fs::directory_iterator(kSpecs / "sets")) {
    INFO(entry.path().string());
    const DataSetSpec set = load_data_set_spec(entry.path());
    CHECK(set.name == entry.path().stem());
    ++sets;
  }
  const TempFolder root;
  for (const auto& entry : fs::directory_iterator(kSpecs / "experiments")) {
    INFO(entry.path().string());
    const ExperimentSpec spec = load_experiment_spec(entry.path());
    CHECK(spec.name == entry.path().stem());
    const bool of_paper = !spec.source.empty();
    if (of_paper) CHECK(contains(spec.source, "ICLR 2026"));
    const std::vector<Job> jobs = make_plan(spec, {.root = root.path()}, no_width);
    CHECK(stated_runs(entry.path().filename()) == jobs.size());
    for (const Job& job : jobs) {
      CHECK(job.data.empty());
      CHECK(job.problem.empty());
      if (!of_paper) continue;
      CHECK(job.published.iterations == 30000);
      CHECK(spec.rows[job.row].published.contains(spec.data[job.set].set.name + "/" + job.scene));
    }
    for (const RowSpec& row : spec.rows) published += row.published.size();
    ++experiments;
    papers += of_paper;
  }
  CHECK(sets == 9);
  CHECK(experiments == 8);
  CHECK(papers == 5);
  // 38 scenes and 5 averages; 3 x (8 + 1); 6 x 4; 6; 6 + 1.
  CHECK(published == 43 + 27 + 24 + 6 + 7);
}

// Each printed average is the mean of the printed scenes: a slip of the keyboard in either shows. Printed
// with two or three digits, they may differ by about a unit: worst 0.0117 dB (7DGS-PBR). Times, FPS, counts
// and sizes are not averaged consistently in print.
TEST_CASE("data_specs: printed averages are those of the printed scenes", "[experiment]") {
  const std::map<std::string, double> tolerance{{"psnr", 0.02}, {"ssim", 0.0011}, {"lpips", 0.0011}};
  std::size_t averages = 0;
  for (const char* file : {"main_table", "capacity", "n3v"}) {
    const ExperimentSpec spec = load_experiment_spec(kSpecs / "experiments" / (std::string(file) + ".yaml"));
    for (const RowSpec& row : spec.rows)
      for (const DataEntry& entry : spec.data)
        for (const auto& [metric, allowed] : tolerance) {
          const auto& printed = row.published.at(entry.set.name + "/average");
          if (!printed.contains(metric)) continue;
          double sum = 0;
          for (const std::string& scene : entry.scenes)
            sum += row.published.at(entry.set.name + "/" + scene).at(metric);
          INFO(file << " " << row.name << " " << entry.set.name << " " << metric);
          CHECK(printed.at(metric) == Approx(sum / static_cast<double>(entry.scenes.size())).margin(allowed));
          ++averages;
        }
  }
  CHECK(averages == 5 * 3 + 3 * 2 + 1);
}

TEST_CASE("data_specs: settings of the paper arrive in the runs", "[experiment]") {
  const TempFolder root;
  const auto settings = [&](const char* file, const std::string& id) {
    const auto jobs =
        make_plan(load_experiment_spec(kSpecs / "experiments" / file), {.root = root.path()}, no_width);
    for (const Job& job : jobs)
      if (job.id == id) return job.settings;
    FAIL("no run " << id);
    return TrainSettings();
  };
  const TrainSettings bicycle = settings("main_table.yaml", "ubs/mip360/bicycle");
  CHECK(bicycle.cap_max == 6'000'000);
  CHECK(bicycle.downscale == 4);
  CHECK(bicycle.principal_point == PrincipalPoint::centre);
  const TrainSettings mutant = settings("main_table.yaml", "ubs/dnerf/mutant");
  CHECK(mutant.dim == 7);
  CHECK(mutant.cap_max == 300'000);
  CHECK(mutant.batch == 4);
  CHECK(settings("ablations.yaml", "skew_nd/dnerf/lego").batch == 1);
  CHECK(settings("ablations.yaml", "skew_nd/dnerf/lego").variant.cov_param == CovParam::skew_nd);
  CHECK(settings("rotations.yaml", "quaternion/mip360/bicycle").dim == 3);
  CHECK(settings("capacity.yaml", "200k/nerf_synthetic/ship").cap_max == 200'000);
}

TEST_CASE("experiments: what is wrong in a file is named with its place", "[experiment]") {
  const TempFolder folder;
  put(folder / "set.yaml", kSet);
  const auto message = [&](const std::string& text) {
    put(folder / "bad.yaml", text);
    return message_of([&] { load_experiment_spec(folder / "bad.yaml"); });
  };
  const std::string head =
      "name: e\npublished: {source: s, columns: [psnr, ssim]}\ndata: [{set: set.yaml}]\n";
  CHECK(message(head + "rows: [{name: a}]\n").empty());
  CHECK(contains(message(head + "rows: [{name: a}]\nrow: 3\n"), "bad.yaml:5:1: unknown key 'row'"));
  CHECK(contains(message(head + "rows:\n  - name: a\n    settings: {cap_mux: 3}\n"),
                 "bad.yaml:6:16: unknown key 'cap_mux'; did you mean 'cap_max'?"));
  CHECK(contains(message(head + "rows:\n  - name: a\n    settings: {cap_max: many}\n"),
                 "bad.yaml:6:16: cap_max"));
  CHECK(contains(message(head + "rows: [{name: a}, {name: a}]\n"), "two rows 'a'"));
  CHECK(contains(message(head + "rows: [{name: ../a}]\n"), "bad.yaml:4:9: the name '../a'"));
  CHECK(contains(message(head + "rows: []\n"), "rows must be a list"));
  const auto published = [&](const std::string& text) {
    return message(head + "rows:\n  - name: a\n    published: {" + text + "}\n");
  };
  CHECK(published("toys: {cube: [30, null], average: [30, 0.9]}").empty());
  CHECK(contains(published("toys: {cube: [30]}"), "one value, or null, for each of the columns psnr, ssim"));
  CHECK(contains(published("toys: {cube: [30, nan]}"), "bad.yaml:6:35: ssim of 'cube' must be a number"));
  CHECK(contains(published("toys: {cone: [30, 1]}"), "'cone' is no scene of 'toys'"));
  CHECK(contains(published("tools: {cube: [30, 1]}"), "'tools' is no data set"));
  CHECK(contains(
      message(
          "name: e\npublished: {source: s, columns: [speed]}\ndata: [{set: set.yaml}]\nrows: [{name: a}]\n"),
      "bad.yaml:2:24: unknown column 'speed'"));
  CHECK(contains(message("name: e\ndata: [{set: set.yaml, scenes: [cone]}]\nrows: [{name: a}]\n"),
                 "no scene 'cone'"));
  CHECK(
      contains(message("name: e\ndata: [{set: none.yaml}]\nrows: [{name: a}]\n"), "none.yaml: no such file"));
  CHECK(contains(message("name: e\nrows: [{name: a}]\n"), "needs the key 'data'"));

  const auto set_message = [&](const std::string& from, const std::string& to) {
    std::string text = kSet;
    text.replace(text.find(from), from.size(), to);
    put(folder / "bad.yaml", text);
    return message_of([&] { load_data_set_spec(folder / "bad.yaml"); });
  };
  CHECK(contains(set_message("licence", "license"), "unknown key 'license' in dataset; did you mean"));
  CHECK(contains(set_message("  split: s\n", ""), "dataset needs the key 'split'"));
  CHECK(contains(set_message("width: 80", "width: wide"), "width = 'wide'"));
}

// Names become folders of results, and folders of data lie below --root.
TEST_CASE("experiments: nothing in a file leads out of --out or --root", "[experiment]") {
  const TempFolder folder;
  put(folder / "set.yaml", kSet);
  put(folder / "secret/x", "");
  put(folder / "root/toys/x", "");
  const auto replaced = [](std::string text, const std::string& from, const std::string& to) {
    return text.replace(text.find(from), from.size(), to);
  };
  const std::string spec = "name: e\ndata: [{set: set.yaml}]\nrows: [{name: r}]\n";
  for (const std::string& name :
       {std::string("../x"), (folder / "x").string(), std::string(".."), std::string("'a\\b'"),
        std::string("\"a\\tb\""), std::string("a/../../b"), std::string(300, 'a'), std::string("''")}) {
    INFO(name);
    for (const char* key : {"name: e", "name: r"}) {
      put(folder / "e.yaml", replaced(spec, key, "name: " + name));
      CHECK(contains(message_of([&] { load_experiment_spec(folder / "e.yaml"); }), "it names folders"));
    }
    for (const char* key : {"name: toys", "cube:"}) {
      const bool scene = key == std::string("cube:");
      put(folder / "bad.yaml", replaced(kSet, key, scene ? name + ":" : "name: " + name));
      CHECK(contains(message_of([&] { load_data_set_spec(folder / "bad.yaml"); }), "it names folders"));
    }
  }
  fs::create_directory_symlink(folder / "secret", folder / "root/toys/linked");
  for (const std::string& place : {std::string("../../secret"), (folder / "secret").string(),
                                   std::string("linked"), std::string("../../../secret")}) {
    INFO(place);
    put(folder / "set.yaml", replaced(kSet, "ball, kugel", "'" + place + "'"));
    put(folder / "e.yaml", spec);
    int found = 0;
    for (const Job& job :
         make_plan(load_experiment_spec(folder / "e.yaml"), {.root = folder / "root"}, no_width)) {
      if (job.data.empty()) continue;
      ++found;
      CHECK(contains(job.problem, "outside of the data folder"));
      CHECK_FALSE(job.runnable());
    }
    CHECK(found == (place == "../../../secret" ? 0 : 1));
  }
}

TEST_CASE("plan: folders are found, overrides follow their order, names must be clear", "[experiment]") {
  const TempFolder folder;
  put(folder / "set.yaml", kSet);
  std::string other = kSet;
  other.replace(other.find("toys"), 4, "cars");
  put(folder / "other.yaml", other);
  put(folder / "e.yaml",
      "name: e\nsettings: {batch: 2, seed: 7}\ndata:\n  - {set: set.yaml, settings: {batch: 3}}\n"
      "  - {set: other.yaml, scenes: [cube]}\nrows:\n  - name: a\n  - name: b\n    settings: {batch: 4, dim: "
      "3}\n");
  const ExperimentSpec spec = load_experiment_spec(folder / "e.yaml");
  put(folder / "root/toys/cube/x", "");
  put(folder / "root/kugel/x", "");
  put(folder / "root/cube/x", "");
  PlanOptions options{.root = folder / "root"};
  std::vector<Job> jobs = make_plan(spec, options, no_width);
  REQUIRE(jobs.size() == 6);
  CHECK(jobs[0].id == "a/toys/cube");
  CHECK(jobs[0].data == folder / "root/toys/cube");
  CHECK(jobs[1].data == folder / "root/kugel");  // another name, directly below the root
  CHECK(jobs[2].id == "a/cars/cube");
  CHECK(jobs[2].data.empty());  // root/cube may be that of either set
  CHECK(contains(jobs[2].looked_for, "root/cars/cube"));
  CHECK(jobs[0].settings.batch == 3);
  CHECK(jobs[2].settings.batch == 2);
  CHECK(jobs[3].settings.batch == 4);
  CHECK(jobs[0].settings.seed == 7);
  CHECK(jobs[0].settings.cap_max == 1000);
  CHECK(jobs[1].settings.cap_max == 2000);
  CHECK(*jobs[0].width == 800);

  options.assignments = {{"batch", "9", "--set"}};
  options.scene_folders = {{"cars/cube", "kugel"}};
  options.rows = {"b"};
  jobs = make_plan(spec, options, no_width);
  REQUIRE(jobs.size() == 3);
  CHECK(jobs[2].data == folder / "root/kugel");
  CHECK(jobs[2].settings.batch == 9);
  CHECK(changed_settings(jobs[2].published, jobs[2].settings) == std::vector<std::string>{"batch 4 -> 9"});

  options = {.root = folder / "root", .scenes = {"sphere"}};
  CHECK(make_plan(spec, options, no_width).size() == 2);
  const auto wrong = [&](const PlanOptions& o) {
    return message_of([&] { make_plan(spec, o, no_width); }, ErrorKind::usage);
  };
  CHECK(contains(wrong({.root = folder / "root", .scenes = {"cube"}}), "write one of toys/cube, cars/cube"));
  CHECK(contains(wrong({.root = folder / "root", .scenes = {"spere"}}), "did you mean 'sphere'?"));
  CHECK(contains(wrong({.root = folder / "root", .rows = {"c"}}), "no row 'c'; there are: a, b"));
  CHECK(contains(wrong({.root = folder / "root", .assignments = {{"bach", "1", "--set"}}}),
                 "unknown key 'bach'"));
  CHECK(contains(message_of([&] { make_plan(spec, {.root = folder / "no"}, no_width); }), "no such folder"));

  const auto broken = [](const fs::path&, const TrainSettings&) -> int { fail(ErrorKind::data, "corrupt"); };
  CHECK(make_plan(spec, {.root = folder / "root"}, broken)[0].problem == "corrupt");
}

TEST_CASE("plan: scaling down keeps the splats a pixel and never enlarges", "[experiment]") {
  const TempFolder folder;
  put(folder / "set.yaml", kSet);
  put(folder / "e.yaml", "name: e\ndata: [{set: set.yaml}]\nrows: [{name: a}]\n");
  put(folder / "root/toys/cube/x", "");
  const ExperimentSpec spec = load_experiment_spec(folder / "e.yaml");
  const auto scaled = [&](int width, int k) {
    const auto size = [&](const fs::path&, const TrainSettings& s) { return width / s.downscale; };
    return make_plan(spec, {.root = folder / "root", .scale_down = k}, size)[0];
  };
  const Job full = scaled(160, 1);  // published: 80 wide, made from 160 by 2
  CHECK(full.settings.downscale == 2);
  CHECK(*full.width == 80);
  const Job quarter = scaled(160, 4);
  CHECK(quarter.settings.downscale == 8);
  CHECK(*quarter.width == 20);
  CHECK(quarter.settings.cap_max == 63);  // 1000 / 16
  CHECK(quarter.settings.init_points == 50);
  CHECK(quarter.settings.iterations == 100);
  CHECK(quarter.published.iterations == 400);
  CHECK(scaled(20, 4).settings.downscale == 1);  // reduced before
  CHECK(scaled(10, 4).settings.downscale == 1);
}

}  // namespace
}  // namespace ubs::experiment
