// SPDX-License-Identifier: Apache-2.0
// ubs experiment as a user meets it, on the embedded scene: a table from real training, resuming after the
// program was killed, a plan with times.
#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "host/metrics/network.hpp"
#include "host/oracle/lpips.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"
#include "tests/support/safetensors.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::contains;
using test::get;
using test::put;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

void prepare(const TempFolder& folder) {
  put(folder / "set.yaml",
      "name: toys\ndataset: {source: synth, licence: Apache-2.0, layout: blender, split: s, resolution: r, "
      "background: black}\nwidth: 32\n"
      "settings: {dim: 3, init_points: 200, cap_max: 250, iterations: 60, save_renders: 0}\nscenes: {shiny: "
      ", dull: }\n");
  put(folder / "e.yaml",
      "name: e\npublished: {source: a book, columns: [psnr, lpips, fps]}\ndata: [{set: set.yaml}]\nrows:\n"
      "  - name: short\n    published: {toys: {shiny: [30, 0.1, 200], dull: [31, null, 300]}}\n"
      "  - name: wrong\n    settings: {near_plane: 5, far_plane: 4}\n");
  test::put_scene(folder / "root/shiny", 32, 6, 2);
}

TEST_CASE("cli: an experiment makes its table, keeps what is done, and says what is not", "[cli]") {
  const TempFolder folder;
  prepare(folder);
  CHECK(run_ubs(folder, "experiment e.yaml --root root --device cpu").code == 2);  // row 'wrong' cannot run
  const std::string table = get(folder / "out/e/table.md");
  CHECK(get(folder / "stdout.txt") == table);
  CHECK(contains(table, "short/toys/dull: no data"));
  CHECK(contains(table, "wrong/toys/shiny: failed: far_plane"));
  CHECK(contains(table, "mean of 1 of 2"));
  const json result = json::parse(get(folder / "out/e/table.json"));
  const json metrics = json::parse(get(folder / "out/e/runs/short.toys.shiny/metrics.json"));
  CHECK(result["runs"][0]["ours"]["psnr"] == metrics["test"]["mean"]["psnr"]);
  CHECK(result["runs"][0]["ours"]["psnr"].get<double>() > 10);
  CHECK(result["runs"][0]["published"]["psnr"] == 30);
  CHECK(result["runs"][0]["ours"]["fps"].get<double>() > 1);
  CHECK(contains(table, "- LPIPS not measured of short/shiny: no weights"));
  CHECK(contains(table, " | – | 0.100 | – |"));
  CHECK(result["runs"][0]["record"]["build"] == metrics["build"]);
  CHECK(contains(get(folder / "out/e/table.csv"), "short,toys,shiny,done,psnr,"));

  CHECK(run_ubs(folder, "experiment e.yaml --root root --device cpu").code == 2);
  CHECK(contains(get(folder / "stderr.txt"), "--resume"));
  put(folder / "begun/runs/short.toys.shiny.partial/checkpoint.ubs", "state");
  CHECK(run_ubs(folder, "experiment e.yaml --root root --device cpu --rows short --out begun").code == 2);
  const auto written = fs::last_write_time(folder / "out/e/runs/short.toys.shiny/model.ply");
  CHECK(run_ubs(folder,
                "experiment e.yaml --root root --device cpu --resume --rows short --scenes dull,shiny --json")
            .code == 0);
  CHECK(fs::last_write_time(folder / "out/e/runs/short.toys.shiny/model.ply") == written);
  CHECK(json::parse(get(folder / "stdout.txt"))["runs"].size() == 2);

  // Weights that come later are used on what was trained before.
  fs::create_directories(folder / "weights");
  CHECK(run_ubs(folder, "experiment e.yaml --root root --rows short --resume --lpips-weights weights").code ==
        3);
  CHECK(contains(get(folder / "stderr.txt"), "lpips_vgg.safetensors"));
  test::put_safetensors(folder / "weights/lpips_vgg.safetensors",
                        oracle::random_weights(lpips_network("vgg"), 3).tensors);
  ubs_ok(folder,
         "experiment e.yaml --root root --device cpu --resume --rows short --json --lpips-weights weights");
  CHECK(fs::last_write_time(folder / "out/e/runs/short.toys.shiny/model.ply") == written);
  const json measured = json::parse(get(folder / "stdout.txt"));
  CHECK(measured["runs"][0]["ours"]["lpips"].get<double>() > 1e-4);
  CHECK(measured["runs"][0]["ours"]["psnr"] == result["runs"][0]["ours"]["psnr"]);

  CHECK(run_ubs(folder, "experiment e.yaml --root root --scenes shine").code == 2);
  CHECK(run_ubs(folder, "experiment e.yaml --root root --scenes dull --out o").code == 3);
  CHECK(contains(get(folder / "stderr.txt"), "no data of any"));
  CHECK_FALSE(fs::exists(folder / "o"));
  CHECK(run_ubs(folder, "experiment e.yaml --root root --scene-folder shiny").code == 2);
}

TEST_CASE("cli: an experiment survives being killed", "[cli]") {
  const TempFolder folder;
  prepare(folder);
  const std::string arguments =
      "experiment e.yaml --root root --device cpu --rows short --scene-folder dull=shiny --resume --quiet";
  // The second job runs until it is killed with the program: no time for either to tidy up.
  const std::string kill = fmt::format(
      "cd '{0}' && {{ '{1}' {2} --set iterations=100000 >/dev/null 2>&1 & program=$!; }}; i=0; "
      "until [ -s out/e/runs/short.toys.shiny.partial/log.csv ] || [ $i -ge 12000 ]; do sleep 0.05; "
      "i=$((i+1)); done; "
      "kill -9 $program",
      folder.path().string(), UBS_EXECUTABLE, arguments);
  REQUIRE(std::system(kill.c_str()) == 0);
  CHECK(fs::exists(folder / "out/e/runs/short.toys.shiny.partial"));
  CHECK_FALSE(fs::exists(folder / "out/e/runs/short.toys.shiny"));
  // Its training process is told by the system, saves and goes; the next start waits for it.
  ubs_ok(folder, arguments);
  const json result = json::parse(get(folder / "out/e/table.json"));
  CHECK(result["runs"][0]["state"] == "done");
  CHECK(result["runs"][0]["ours"]["iterations"] == 60);
  CHECK(result["runs"][1]["ours"]["psnr"] == result["runs"][0]["ours"]["psnr"]);  // the same data
  CHECK(result["means"][0]["scenes_present"] == 2);
  for (const auto& entry : fs::directory_iterator(folder / "out/e/runs"))
    CHECK(entry.path().extension() != ".partial");
}

TEST_CASE("cli: a dry run plans and changes nothing", "[cli]") {
  const TempFolder folder;
  prepare(folder);
  ubs_ok(folder,
         "experiment e.yaml --root root --device cpu --dry-run --json --set iterations=30000 --scale-down");
  const json plan = json::parse(get(folder / "stdout.txt"));
  REQUIRE(plan["runs"].size() == 4);
  CHECK(plan["runs"][0]["not_as_published"] ==
        json{"init_points 200 -> 13", "cap_max 250 -> 16", "iterations 60 -> 30000", "downscale 1 -> 4"});
  CHECK(plan["runs"][0]["start"]["splats"] == 13);
  CHECK(plan["runs"][0]["end"]["splats"] == 13);  // 1.02 times as many are not one more
  CHECK(plan["runs"][0]["hours"].get<double>() > 0);
  CHECK(plan["runs"][0]["reason"] == "");
  CHECK(plan["runs"][1]["hours"].is_null());
  CHECK(contains(plan["runs"][2]["reason"], "far_plane"));
  CHECK_FALSE(fs::exists(folder / "out"));
}

}  // namespace
}  // namespace ubs
