// SPDX-License-Identifier: Apache-2.0
// `ubs reduce`, `--dim auto` and mixed files as a user meets them.
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "host/data/ply.hpp"
#include "tests/support/temp_folder.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
using nlohmann::json;

namespace {

struct Result {
  int code;
  std::string out, err;
};

Result run(const TempFolder& folder, const std::string& arguments) {
  const std::string command = fmt::format("cd '{}' && '{}' {} >out.txt 2>err.txt </dev/null",
                                          folder.path().string(), UBS_EXECUTABLE, arguments);
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, get(folder / "out.txt"), get(folder / "err.txt")};
}

std::string run_ok(const TempFolder& folder, const std::string& arguments) {
  const Result result = run(folder, arguments);
  INFO("ubs " << arguments << "\n" << result.err);
  REQUIRE(result.code == 0);
  return result.out;
}

}  // namespace

TEST_CASE("cli: train --dim auto, reduce, and what reads the result", "[reduce]") {
  const TempFolder folder;
  run_ok(folder, "synth orbit --out data --size 32 --views 8 --test-views 3 --supersampling 1");
  const json trained = json::parse(run_ok(
      folder,
      "train --data data --out run --dim auto --iterations 200 --init-points 300 --cap-max 350 --json"));
  CHECK(trained["dim"] == 7);
  CHECK(trained["data_report"]["notes"].back().get<std::string>().find(
            "dim auto: N = 7, 8 different times") == 0);
  CHECK(get(folder / "run/config.yaml").find("dim: 7") != std::string::npos);

  const json reduced = json::parse(run_ok(
      folder,
      "reduce --model run/model.ply --data data --out r.ply --bound 0.1 --effects e.csv --json --quiet"));
  CHECK(reduced["bound_holds"] == true);
  CHECK(reduced["before"]["splats"] == 350);
  CHECK(reduced["after"]["splats"] < 350);
  CHECK(reduced["after"]["bytes"] < reduced["before"]["bytes"]);
  CHECK(reduced["train"]["values_beyond_bound"] == 0);
  CHECK(reduced["test"]["after"]["psnr"].get<double>() > 5);
  CHECK(get(folder / "e.csv").find("splat,dim,views,weight,opacity_range_3,") == 0);
  const MixedModel model = read_mixed_ply(folder / "r.ply");
  REQUIRE(model.mixed());
  CHECK(model.count() == reduced["after"]["splats"]);

  const json measured = json::parse(run_ok(folder, "eval --model r.ply --data data --json"));
  CHECK(measured["mean"]["psnr"].get<double>() ==
        Approx(reduced["test"]["after"]["psnr"].get<double>()).margin(1e-9));
  CHECK(measured["groups"].size() == model.groups.size());
  run_ok(folder, "render --model r.ply --data data --out images --views 0");
  CHECK_THAT(run_ok(folder, "info r.ply"), Contains("group of N ="));
  run_ok(folder, "gradients --model r.ply --data data --view 0 --out g.ply");
  CHECK(read_mixed_ply(folder / "g.ply").parameters() == model.parameters());
  CHECK_THAT(run(folder, "convert r.ply o.ply").err, Contains("several dimensions"));

  const json searched = json::parse(
      run_ok(folder, "reduce --model r.ply --data data --out s.ply --max-loss-db 0.5 --json --quiet"));
  CHECK(searched["train"]["before"]["psnr"].get<double>() -
            searched["train"]["after"]["psnr"].get<double>() <=
        0.5);
  CHECK(searched["search"].size() == 9);
}

TEST_CASE("cli: reduce refuses what makes no sense", "[reduce]") {
  const TempFolder folder;
  run_ok(folder, "synth glossy --out data --size 16 --views 2 --test-views 1 --supersampling 1");
  SplatModel nothing(6, 3);
  for (std::size_t i = 0; i < 3; ++i) nothing.row(nothing.layout().opacity)[i] = -200;
  write_splat_ply(folder / "m.ply", nothing);
  const auto refused = [&](const std::string& arguments, int code, const std::string& reason) {
    const Result result = run(folder, "reduce --quiet --data data " + arguments);
    INFO(arguments << "\n" << result.err);
    CHECK(result.code == code);
    CHECK_THAT(result.err, Contains(reason));
    CHECK(!std::filesystem::exists(folder / "r.ply"));
  };
  refused("--model m.ply --out r.ply --lossless", 3, "no splat is left");
  refused("--model m.ply --out m.ply", 2, "is the model itself");
  refused("--model m.ply --out r.ply --lossless --bound 0.1", 2, "exclude one another");
  refused("--model none.ply --out r.ply", 3, "none.ply");
  refused("--model m.ply --out r.ply --bound 2", 2, "bound");
}
