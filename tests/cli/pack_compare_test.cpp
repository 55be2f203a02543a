// SPDX-License-Identifier: Apache-2.0
// Tests `ubs pack` and `ubs-lab compare` as users run them. Training on a packed set must give the same model
// as training on the folder from which the set was packed.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

using nlohmann::json;
using test::get;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

constexpr const char* kShort =
    "--device cpu --iterations 20 --set init_points=300 --set cap_max=300 --save-renders 1 --quiet";

TEST_CASE("a packed set gives the same model as its folder, and both rasterisers render it alike", "[cli]") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 32 --views 6 --test-views 2");
  ubs_ok(folder, "pack data --out set.ubsd --json");
  const json packed = json::parse(get(folder / "stdout.txt"));
  CHECK(packed["splits"]["train"]["images"] == 6);
  CHECK(packed["splits"]["test"]["views"] == 2);

  ubs_ok(folder, fmt::format("train --data data --out a {}", kShort));
  ubs_ok(folder, fmt::format("train --data set.ubsd --out b {}", kShort));
  CHECK(get(folder / "a/model.ply") == get(folder / "b/model.ply"));

  ubs_ok(folder,
         "compare --devices cpu@cpu,cpu@gpu --model a/model.ply --data set.ubsd --repeat 1 "
         "--train-iterations 3 --set init_points=200 --out c --json");
  const json result = json::parse(get(folder / "stdout.txt"));
  REQUIRE(result["devices"].size() == 2);
  const json &first = result["devices"][0]["values"], &second = result["devices"][1]["values"];
  CHECK(first["image_max_difference"] == 0);
  CHECK(second["image_max_difference"].get<double>() < 2e-5);
  CHECK(second["image_max_difference"].get<double>() >
        0);  // the order of the sums differs, so equal images would mean that the same rasteriser ran twice
  CHECK(second["gradient_difference xyz"].get<double>() < 1e-3);
  CHECK(second["train_iterations"] == 3);
  CHECK(second["stage_ms raster_gpu_forward"].get<double>() > 0);
  for (const char* name : {"compare.json", "compare.csv", "compare.md"})
    CHECK(get(folder / (std::string("c/") + name)).find("cpu@gpu") != std::string::npos);
}

TEST_CASE("packed sets and comparisons reject invalid arguments", "[cli]") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 32 --views 3 --test-views 1");
  ubs_ok(folder, "pack data --out set.ubsd");
  CHECK(run_ubs(folder, fmt::format("train --data set.ubsd --background 1,1,1 --out a {}", kShort)).code ==
        3);
  CHECK(get(folder / "stderr.txt").find("--background 0,0,0") != std::string::npos);
  CHECK(run_ubs(folder, fmt::format("train --data set.ubsd --downscale 2 --out a {}", kShort)).code == 3);
  const auto refused = [&](const std::string& arguments, const std::string& message) {
    CHECK(run_ubs(folder, arguments).code == 2);
    CHECK(get(folder / "stderr.txt").find(message) != std::string::npos);
  };
  for (const char* option : {"--test-every 3", "--images foo", "--colmap-model 1", "--frames 0:3"})
    refused(fmt::format("info set.ubsd {}", option), "the layout packed does not use --");
  refused(fmt::format("train --data set.ubsd --images foo --out a {}", kShort), "does not use --images");
  refused("info set.ubsd --layout nerfstudio", "packed data set, so the layout cannot be nerfstudio");
  CHECK(run_ubs(folder, "pack absent --out other.ubsd").code == 3);
  CHECK_FALSE(std::filesystem::exists(folder / "other.ubsd"));
  // Names of devices may contain '@'.
  ubs_ok(folder, fmt::format("train --data set.ubsd --out at {}", kShort));
  CHECK(run_ubs(folder, "compare --devices 'Some CPU @ 3.60GHz@cpu' --model at --data set.ubsd").code == 4);
  CHECK(get(folder / "stderr.txt").find("'Some CPU @ 3.60GHz' matches no device") != std::string::npos);
  CHECK(run_ubs(folder, "compare --devices 'Some CPU @ 3.60GHz' --model at --data set.ubsd").code == 4);
  CHECK(get(folder / "stderr.txt").find("'Some CPU @ 3.60GHz' matches no device") != std::string::npos);
  ubs_ok(folder, fmt::format("train --data set.ubsd --out a {}", kShort));
  CHECK(run_ubs(folder, "compare --devices quantum --model a/model.ply --data set.ubsd").code == 4);
  CHECK(run_ubs(folder, "compare --devices cpu --view 9 --model a/model.ply --data set.ubsd").code == 2);
}

}  // namespace
}  // namespace ubs
