// SPDX-License-Identifier: Apache-2.0
// ubs accuracy as a process: files, fronts, comparison with a baseline and its exit code, refusals.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "host/bench/bench_scene.hpp"
#include "host/data/model_notes.hpp"
#include "host/data/ply.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

using Catch::Contains;
using Catch::StartsWith;
using nlohmann::json;
using test::get;
using test::put;
using test::Result;
using test::run_ubs;
using test::TempFolder;

void scale_errors(json& at, double factor) {
  for (json& child : at) {
    if (child.is_object() && child.contains("typical"))
      child["typical"] = factor * child["typical"].get<double>();
    else if (child.is_structured())
      scale_errors(child, factor);
  }
}

TEST_CASE("accuracy: files, front, baseline") {
  const TempFolder folder;
  const std::string run =
      "accuracy --quick --config fast:math=rough --config never:rot_mode=quaternion --out ";
  const Result first = run_ubs(folder, run + "a");
  INFO(first.err);
  REQUIRE(first.code == 0);
  CHECK_THAT(first.out, Contains("| 1 | default |") && Contains("| 2 | fast |"));
  json file = json::parse(get(folder / "a/accuracy.json"));
  CHECK_THAT(file.at("truth").get<std::string>(), Contains("float64"));
  const json& results = file.at("results");
  REQUIRE(results.size() == 3);
  CHECK(results[0].at("image").at("relative") < 1e-5);
  CHECK(results[1].at("image").at("relative") > 1e-5);
  CHECK(results[0].at("image_front"));
  CHECK(results[0].at("stages").contains("lists + raster_forward"));
  CHECK_THAT(results[2].at("note").get<std::string>(), Contains("rot_mode = quaternion"));
  CHECK_THAT(get(folder / "a/accuracy.svg"), StartsWith("<svg") && Contains("not on the front"));
  CHECK_THAT(get(folder / "a/accuracy.md"),
             Contains("![error against time](accuracy.svg)") && Contains("* truth: float64"));

  const Result same = run_ubs(folder, run + "b --baseline a/accuracy.json");
  CHECK(same.code == 0);
  CHECK_THAT(same.out, Contains("0 of "));
  CHECK(get(folder / "b/accuracy.csv").size() > 1000);
  scale_errors(file, 0.01);
  put(folder / "better.json", file.dump());
  const Result worse = run_ubs(folder, run + "c --quiet --baseline better.json");
  CHECK(worse.code == 8);
  CHECK_THAT(worse.out, Contains("WORSE"));
}

TEST_CASE("accuracy: a model is drawn as it wants to be; --json is JSON beside --baseline too") {
  const TempFolder folder;
  test::put_scene(folder / "data", 32, 2, 1);
  write_splat_ply(folder / "m.ply", bench::random_start(6, 200, 32, 32).model,
                  comments_of({.drawing = {{"eps2d", "50"}}, .cameras = {}}));
  const auto error = [&](const std::string& options) {
    const Result run = test::ubs_ok(folder,
                                    "accuracy m.ply data --no-stages --rounds 1 --sample-ms 0.1 --config "
                                    "default --json --out " +
                                        options);
    return json::parse(run.out).at("results")[0].at("image").at("relative").get<double>();
  };
  const double noted = error("a");
  CHECK(noted == error("b --eps2d 50 --baseline a/accuracy.json"));
  CHECK(noted != error("b --eps2d 0.3"));
}

TEST_CASE("accuracy: what is refused") {
  const TempFolder folder;
  CHECK(run_ubs(folder, "accuracy --quick").code == 2);
  CHECK(run_ubs(folder, "accuracy --quick --out a --config x:maths=native").code == 2);
  // What nothing asked for gave rows like the default's, and an N without its query values an internal error.
  check_error(folder, "accuracy --quick --out a --config x:dim=3", 2, "dim of 'x' changes nothing here");
  check_error(folder, "accuracy --quick --out a --config 'x:rot_mode=exp|math=native'", 2, "math of 'x'");
  CHECK(run_ubs(folder, "accuracy --quick --out a --dim 8").code == 2);
  CHECK(run_ubs(folder, "accuracy --quick --out a --model m.ply").code == 3);  // no such file
  put(folder / "m.ply", "a model");
  CHECK(run_ubs(folder, "accuracy --quick --out a --model m.ply").code == 2);  // of which data?
  CHECK(run_ubs(folder, "accuracy --quick --out a --baseline none.json").code == 3);
  const Result none = run_ubs(
      folder, "accuracy --quick --out a --config default:rot_mode=quaternion --config x:rot_mode=quaternion");
  CHECK(none.code == 0);  // the default runs beside them
}

// It took its own numbers all the same; a baseline without anything of the run passed, and devices of one
// name were mixed.
TEST_CASE("accuracy: --quick leaves what is chosen") {
  const TempFolder folder;
  put(folder / "other.json", R"({"results": []})");
  const auto check_uncompared = [&](const std::string& arguments) {
    const Result run = run_ubs(folder, arguments + " --baseline other.json");
    CHECK(run.code == 3);
    CHECK_THAT(run.err, Contains("nothing was compared"));
  };
  check_uncompared(
      "accuracy --quick --no-stages --quiet --config fast:math=native --splats 90 --size 33 "
      "--iterations 2 --rounds 1 --sample-ms 0.1 --device cpu,cpu --out a");
  CHECK_THAT(get(folder / "a/accuracy.json"), Contains(" [0]\"") && Contains(" [1]\""));
  CHECK_THAT(get(folder / "a/accuracy.md"),
             Contains(" 90 splats, N = 6, view 0 of 33x33") && Contains("medians of 1 rounds"));
}

}  // namespace
}  // namespace ubs
