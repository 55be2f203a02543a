// SPDX-License-Identifier: Apache-2.0
// Tests that run `ubs-lab accuracy` as a process. They check the files that it writes, the settings with
// which a model is rendered, and that invalid arguments are rejected.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "host/formats/model_notes.hpp"
#include "host/formats/ply.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

using Catch::Contains;
using nlohmann::json;
using test::get;
using test::put;
using test::Result;
using test::run_ubs;
using test::TempFolder;

TEST_CASE("accuracy: the errors and times of each configuration are printed and written") {
  const TempFolder folder;
  const Result run =
      run_ubs(folder, "accuracy --quick --config fast:math=rough --config never:rot_mode=quaternion --out a");
  INFO(run.err);
  REQUIRE(run.code == 0);
  CHECK_THAT(run.out, Contains("\ndefault ") && Contains("\nfast ") && Contains("\nnever "));
  const json results = json::parse(get(folder / "a/accuracy.json")).at("results");
  REQUIRE(results.size() == 3);
  const auto image_error = [&](std::size_t row) {
    return results[row].at("stages").at("forward").at("errors").at("image").at("relative").get<double>();
  };
  CHECK(image_error(0) < 1e-5);
  CHECK(image_error(1) > 1e-5);
  for (const char* stage : {"forward", "iteration", "project_forward", "lists + raster_forward", "image_loss",
                            "raster_backward", "project_backward"})
    CHECK(results[0].at("stages").at(stage).at("median_ms") > 0);
  const double contributions = results[0].at("contributions_per_pixel").get<double>();
  CHECK((contributions > 0.1 && contributions < 600));  // the scene has 600 splats
  CHECK(results[1].at("contributions_per_pixel") == contributions);
  CHECK_FALSE(results[2].contains("contributions_per_pixel"));
  CHECK_THAT(results[2].at("note").get<std::string>(), Contains("rot_mode = quaternion"));
  CHECK_THAT(get(folder / "a/accuracy.csv"), Contains("\nfast,same,6,glossy,"));
}

TEST_CASE("accuracy: a model is rendered with its own settings") {
  const TempFolder folder;
  test::put_scene(folder / "data", 32, 2, 1);
  write_splat_ply(folder / "m.ply", bench::random_start(6, 200, 32, 32).model,
                  comments_of({.drawing = {{"eps2d", "50"}}, .cameras = {}}));
  const auto error = [&](const std::string& options) {
    test::ubs_ok(folder, "accuracy m.ply data --quick --config default --out a --overwrite " + options);
    const json result = json::parse(get(folder / "a/accuracy.json")).at("results")[0];
    return result.at("stages").at("forward").at("errors").at("image").at("relative").get<double>();
  };
  const double noted = error("");
  CHECK(noted == error("--eps2d 50"));
  CHECK(noted != error("--eps2d 0.3"));
}

TEST_CASE("accuracy: invalid arguments are rejected") {
  const TempFolder folder;
  CHECK(run_ubs(folder, "accuracy --quick").code == 2);
  CHECK(run_ubs(folder, "accuracy --quick --out a --config x:maths=native").code == 2);
  // Earlier versions printed rows equal to the default for settings without effect, and failed with an
  // internal error for an N that requires query values.
  check_error(folder, "accuracy --quick --out a --config x:dim=3", 2, "dim of 'x' has no effect here");
  check_error(folder, "accuracy --quick --out a --config 'x:rot_mode=exp|math=native'", 2, "math of 'x'");
  CHECK(run_ubs(folder, "accuracy --quick --out a --dim 8").code == 2);
  CHECK(run_ubs(folder, "accuracy --quick --out a --model m.ply").code == 3);  // the file does not exist
  put(folder / "m.ply", "a model");
  CHECK(run_ubs(folder, "accuracy --quick --out a --model m.ply").code == 2);  // --model requires data
  const Result none = run_ubs(
      folder, "accuracy --quick --out a --config default:rot_mode=quaternion --config x:rot_mode=quaternion");
  CHECK(none.code == 0);  // both configurations are skipped, but the default configuration is measured, too
}

// Earlier versions ignored the numbers of splats, pixels, iterations and rounds with --quick, and confused
// devices with the same name.
TEST_CASE("accuracy: --quick does not override options of the command line") {
  const TempFolder folder;
  test::ubs_ok(
      folder,
      "accuracy --quick --config fast:math=native --splats 90 --size 33 --iterations 2 --rounds 1 --dim 3 "
      "--device cpu,cpu --out a");
  CHECK_THAT(get(folder / "a/accuracy.json"),
             Contains(" [0]\"") && Contains(" [1]\"") && Contains("\"dim\": 3"));
}

}  // namespace
}  // namespace ubs
