// SPDX-License-Identifier: Apache-2.0
// ubs stress as a user meets it.
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "host/stress/row_scene.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

using nlohmann::json;
using test::get;
using test::TempFolder;

int ubs(const TempFolder& folder, const std::string& arguments) {
  const int status = std::system(fmt::format("cd '{}' && '{}' {} >out.txt 2>err.txt </dev/null",
                                             folder.path().string(), UBS_EXECUTABLE, arguments)
                                     .c_str());
  INFO("ubs " << arguments << "\n" << get(folder / "err.txt"));
  CHECK(WIFEXITED(status));
  return WEXITSTATUS(status);
}

TEST_CASE("a stress run leaves a table, JSON and a page", "[cli][stress]") {
  const TempFolder folder;
  REQUIRE(ubs(folder,
              "stress --device opencl --run '^01|^10|random' --cases 20 --seed 5 --json r.json --out o") ==
          0);
  const std::string table = get(folder / "out.txt");
  CHECK(table.find("01.near_plane") != std::string::npos);
  CHECK(table.find("passed") != std::string::npos);
  const json result = json::parse(get(folder / "r.json"));
  CHECK(result["seed"] == 5);
  CHECK(result["cases"] == 20);
  CHECK(result["rows"][0]["name"] == "01.near_plane");
  CHECK(result["rows"][0]["gradient_error"].get<double>() > 0);
  CHECK(result["rows"][1].contains("elsewhere"));
  std::size_t random = 0;
  for (const json& row : result["rows"])
    if (row["name"].get<std::string>().starts_with("random")) random += row["cases"].get<std::size_t>();
  CHECK(random == 20);
  CHECK(get(folder / "o/stress.md").find("| 01.near_plane |") != std::string::npos);
}

TEST_CASE("ubs stress lists its rows, and refuses what it does not know", "[cli][stress]") {
  const TempFolder folder;
  REQUIRE(ubs(folder, "stress --list") == 0);
  CHECK(get(folder / "out.txt").find("25.loss") != std::string::npos);
  CHECK(ubs(folder, "stress --run nothing_of_the_kind") == 2);
  CHECK(ubs(folder, "stress --run '('") == 2);
  CHECK(ubs(folder, "stress --replay nowhere") == 3);
  CHECK(get(folder / "err.txt").find("case.json") != std::string::npos);
}

TEST_CASE("a saved case is replayed", "[cli][stress]") {
  const TempFolder folder;
  stress::save_case(stress::ordinary_case("kept", 6, 3), folder / "kept");
  REQUIRE(ubs(folder, "stress --device opencl --replay kept") == 0);
  CHECK(get(folder / "out.txt").find("gradient error") != std::string::npos);
  REQUIRE(ubs(folder, "render --device opencl --model kept/model.ply --data kept --out image --format npy") ==
          0);
  CHECK(std::filesystem::exists(folder / "image/view.npy"));
}

}  // namespace
}  // namespace ubs
