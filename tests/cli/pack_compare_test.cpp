// SPDX-License-Identifier: Apache-2.0
// ubs pack and ubs compare as a user meets them: a packed set trains to the same model as its folder, and
// devices are compared with each other.
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>

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

constexpr const char* kShort =
    "--device cpu --iterations 20 --set init_points=300 --set cap_max=300 --save-renders 1 --quiet";

TEST_CASE("a packed set trains to the bytes of its folder, and devices agree on the model", "[cli]") {
  const TempFolder folder;
  REQUIRE(ubs(folder, "synth glossy --out data --size 32 --views 6 --test-views 2") == 0);
  REQUIRE(ubs(folder, "pack data --out set.ubsd --json") == 0);
  const json packed = json::parse(get(folder / "out.txt"));
  CHECK(packed["splits"]["train"]["images"] == 6);
  CHECK(packed["splits"]["test"]["views"] == 2);

  REQUIRE(ubs(folder, fmt::format("train --data data --out a {}", kShort)) == 0);
  REQUIRE(ubs(folder, fmt::format("train --data set.ubsd --out b {}", kShort)) == 0);
  CHECK(get(folder / "a/model.ply") == get(folder / "b/model.ply"));

  REQUIRE(ubs(folder,
              "compare --devices cpu@cpu,cpu@gpu --model a/model.ply --data set.ubsd --repeat 1 "
              "--train-iterations 3 --set init_points=200 --out c --json") == 0);
  const json result = json::parse(get(folder / "out.txt"));
  REQUIRE(result["devices"].size() == 2);
  const json &first = result["devices"][0]["values"], &second = result["devices"][1]["values"];
  CHECK(first["image_max_difference"] == 0);
  CHECK(second["image_max_difference"].get<double>() < 2e-5);
  CHECK(second["image_max_difference"].get<double>() > 0);  // other sums: it did run another rasteriser
  CHECK(second["gradient_difference xyz"].get<double>() < 1e-3);
  CHECK(second["train_iterations"] == 3);
  CHECK(second["stage_ms raster_gpu_forward"].get<double>() > 0);
  for (const char* name : {"compare.json", "compare.csv", "compare.md"})
    CHECK(get(folder / (std::string("c/") + name)).find("cpu@gpu") != std::string::npos);
}

TEST_CASE("packed sets and comparisons refuse what cannot be right", "[cli]") {
  const TempFolder folder;
  REQUIRE(ubs(folder, "synth glossy --out data --size 32 --views 3 --test-views 1") == 0);
  REQUIRE(ubs(folder, "pack data --out set.ubsd") == 0);
  CHECK(ubs(folder, fmt::format("train --data set.ubsd --background 1,1,1 --out a {}", kShort)) == 3);
  CHECK(get(folder / "err.txt").find("--background 0,0,0") != std::string::npos);
  CHECK(ubs(folder, fmt::format("train --data set.ubsd --downscale 2 --out a {}", kShort)) == 3);
  CHECK(ubs(folder, "pack absent --out other.ubsd") == 3);
  CHECK_FALSE(std::filesystem::exists(folder / "other.ubsd"));
  REQUIRE(ubs(folder, fmt::format("train --data set.ubsd --out a {}", kShort)) == 0);
  CHECK(ubs(folder, "compare --devices quantum --model a/model.ply --data set.ubsd") == 4);
  CHECK(ubs(folder, "compare --devices cpu --view 9 --model a/model.ply --data set.ubsd") == 2);
}

}  // namespace
}  // namespace ubs
