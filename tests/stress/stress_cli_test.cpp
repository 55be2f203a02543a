// SPDX-License-Identifier: Apache-2.0
// ubs-lab stress as a user meets it.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "host/stress/row_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

using nlohmann::json;
using test::get;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

TEST_CASE("a stress run leaves a table, JSON and a page", "[cli][stress]") {
  const TempFolder folder;
  ubs_ok(folder, "stress --device opencl --run '^01|random' --cases 20 --seed 5 --json r.json --out o");
  const std::string table = get(folder / "stdout.txt");
  CHECK(table.find("01.near_plane") != std::string::npos);
  CHECK(table.find("passed") != std::string::npos);
  const json result = json::parse(get(folder / "r.json"));
  CHECK(result["seed"] == 5);
  CHECK(result["cases"] == 20);
  CHECK(result["rows"][0]["name"] == "01.near_plane");
  CHECK(result["rows"][0]["gradient_error"].get<double>() > 0);
  std::size_t random = 0;
  for (const json& row : result["rows"])
    if (row["name"].get<std::string>().starts_with("random")) random += row["cases"].get<std::size_t>();
  CHECK(random == 20);
  CHECK(get(folder / "o/stress.md").find("| 01.near_plane |") != std::string::npos);
}

TEST_CASE("ubs-lab stress lists its rows, and refuses what it does not know", "[cli][stress]") {
  const TempFolder folder;
  ubs_ok(folder, "stress --list");
  CHECK(get(folder / "stdout.txt").find("25.loss") != std::string::npos);
  CHECK(run_ubs(folder, "stress --run nothing_of_the_kind").code == 2);
  CHECK(run_ubs(folder, "stress --run '('").code == 2);
  CHECK(run_ubs(folder, "stress --replay nowhere").code == 3);
  CHECK(get(folder / "stderr.txt").find("case.json") != std::string::npos);
}

TEST_CASE("a saved case is replayed", "[cli][stress]") {
  const TempFolder folder;
  stress::save_case(stress::ordinary_case("kept", 6, 3), folder / "kept");
  ubs_ok(folder, "stress --device opencl --replay kept");
  CHECK(get(folder / "stdout.txt").find("gradient error") != std::string::npos);
  ubs_ok(folder, "render --device opencl --model kept/model.ply --data kept --out image --format npy");
  CHECK(std::filesystem::exists(folder / "image/view.npy"));
}

}  // namespace
}  // namespace ubs
