// SPDX-License-Identifier: Apache-2.0
// ubs sweep as a process: machine-readable output, files, and the exit code of a wrong name.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "host/data/image.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

TEST_CASE("ubs sweep writes what it prints", "[stress]") {
  const test::TempFolder folder;
  REQUIRE(test::run_ubs(folder, "sweep rim needle_3d --quick --no-times --json --out out").code == 0);
  const auto json = nlohmann::json::parse(test::get(folder / "stdout.txt"));
  REQUIRE(json["sweeps"].size() == 2);
  CHECK(json["sweeps"][0]["name"] == "needle_3d");  // in the order of the list
  CHECK(json["sweeps"][0]["points"].size() == 3);
  CHECK(json["sweeps"][0]["points"][0]["safe"]["gradient"].get<double>() > 0);
  CHECK(!json.contains("nanoseconds"));
  const auto file = nlohmann::json::parse(test::get(folder / "out/sweep.json"));
  CHECK(file["sweeps"] == json["sweeps"]);
  CHECK(test::get(folder / "out/sweep.csv").starts_with("sweep,x,splats,culled,safe_value"));
  CHECK(load_image(folder.path() / "out/sweep.png").width > 1000);
}

TEST_CASE("ubs sweep refuses a name that does not exist", "[stress]") {
  const test::TempFolder folder;
  CHECK(test::run_ubs(folder, "sweep needel").code == 2);
  CHECK(test::get(folder / "stderr.txt").find("no sweep 'needel'") != std::string::npos);
}

}  // namespace
}  // namespace ubs
