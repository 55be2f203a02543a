// SPDX-License-Identifier: Apache-2.0
// ubs accuracy and ubs accuracy curve as processes: files, fronts, comparison with a baseline and its exit
// code, refusals.
#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "host/accuracy/csv.hpp"
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

// As a baseline file, with errors times a factor.
std::string scaled(const std::filesystem::path& file, double factor) {
  const std::vector<std::string> words{"device", "scene", "configuration", "stage", "quantity"};
  std::string text = fmt::format("{},typical_error,time_ratio\n", fmt::join(words, ","));
  for (const auto& row : accuracy::read_csv(file, words)) {
    for (const std::string& word : words) text += accuracy::csv_field(row.at(word)) + ",";
    text += fmt::format("{},{}\n", factor * std::stod(row.at("typical_error")), row.at("time_ratio"));
  }
  return text;
}

TEST_CASE("accuracy: files, front, baseline") {
  const TempFolder folder;
  const std::string run =
      "accuracy --quick --config fast:math=rough --config never:rot_mode=quaternion --out ";
  const Result first = run_ubs(folder, run + "a");
  INFO(first.err);
  REQUIRE(first.code == 0);
  CHECK_THAT(first.out, Contains("| 1 | default |") && Contains("| 2 | fast |"));
  const json file = json::parse(get(folder / "a/accuracy.json"));
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

  const Result same = run_ubs(folder, run + "b --baseline a/accuracy.csv");
  CHECK(same.code == 0);
  CHECK_THAT(same.out, Contains("0 of "));
  CHECK(get(folder / "b/accuracy.csv").size() > 1000);
  put(folder / "better.csv", scaled(folder / "a/accuracy.csv", 0.01));
  const Result worse = run_ubs(folder, run + "c --baseline better.csv");
  CHECK(worse.code == 8);
  CHECK_THAT(worse.out, Contains("WORSE"));
}

TEST_CASE("accuracy: what is refused") {
  const TempFolder folder;
  CHECK(run_ubs(folder, "accuracy --quick").code == 2);
  CHECK(run_ubs(folder, "accuracy --quick --out a --config x:maths=native").code == 2);
  CHECK(run_ubs(folder, "accuracy --quick --out a --model m.ply").code == 3);  // no such file
  put(folder / "m.ply", "a model");
  CHECK(run_ubs(folder, "accuracy --quick --out a --model m.ply").code == 2);  // of which data?
  CHECK(run_ubs(folder, "accuracy --quick --out a --baseline none.csv").code == 3);
  const Result none = run_ubs(
      folder, "accuracy --quick --out a --config default:rot_mode=quaternion --config x:rot_mode=quaternion");
  CHECK(none.code == 0);  // the default runs beside them
}

// It took its own numbers all the same.
TEST_CASE("accuracy, curve: --quick leaves what is chosen") {
  const TempFolder folder;
  test::ubs_ok(folder,
               "accuracy --quick --no-stages --quiet --config fast:math=native --splats 90 --size 33 "
               "--iterations 2 --rounds 1 --sample-ms 0.1 --out a");
  CHECK_THAT(get(folder / "a/accuracy.md"),
             Contains(" 90 splats, N = 6, view 0 of 33x33") && Contains("medians of 1 rounds"));
  test::ubs_ok(folder, "accuracy curve --quick --quiet --config a:dim=3 --iterations 4 --cap-max 70 --out c");
  const auto rows = accuracy::read_csv(folder / "c/curve.csv", {"iteration", "splats"});
  REQUIRE(rows.size() == 4);
  CHECK(rows[3].at("iteration") == "4");
  CHECK(rows[3].at("splats") == "70");
}

TEST_CASE("curve: files and baseline") {
  const TempFolder folder;
  const std::string run = "accuracy curve --quick --config a:dim=3 --config b:dim=6,math=native --out ";
  const Result first = run_ubs(folder, run + "a");
  INFO(first.err);
  REQUIRE(first.code == 0);
  const auto rows =
      accuracy::read_csv(folder / "a/curve.csv", {"configuration", "iteration", "seconds", "psnr", "ssim"});
  REQUIRE(rows.size() == 40);  // 60 iterations, evaluated every third
  CHECK(rows[0].at("configuration") == "a");
  CHECK(rows[0].at("iteration") == "3");
  CHECK(rows[39].at("configuration") == "b");
  CHECK(std::stod(rows[19].at("psnr")) > std::stod(rows[0].at("psnr")));
  CHECK_THAT(get(folder / "a/curve.svg"), StartsWith("<svg") && Contains("Test SSIM"));
  CHECK(json::parse(get(folder / "a/curve.json")).at("curves").size() == 2);

  std::string csv = get(folder / "a/curve.csv");
  // Quality is a function of settings, data and device: the same again, also with the trainings one by one.
  const Result same = run_ubs(folder, run + "b --sequential --baseline a/curve.csv");
  CHECK(same.code == 0);
  CHECK_THAT(same.out, Contains("+0.000"));
  const std::string last = rows[39].at("psnr");
  const std::size_t at = csv.rfind("," + last + ",");
  csv.replace(at + 1, last.size(), "99");
  put(folder / "better.csv", csv);
  CHECK(run_ubs(folder, run + "c --baseline better.csv").code == 8);
  CHECK(run_ubs(folder, "accuracy curve --quick --config a:dim=3 --config a:dim=6 --out d").code == 2);
  CHECK(run_ubs(folder,
                "accuracy curve --quick --config a:dim=3,kernel=gaussian,rot_mode=quaternion,freeze=nothing "
                "--out d")
            .code == 2);
}

}  // namespace
}  // namespace ubs
