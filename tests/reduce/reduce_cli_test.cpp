// SPDX-License-Identifier: Apache-2.0
// Tests the command `ubs reduce`, `ubs train --dim auto`, and the commands that read models whose splats have
// different dimensions.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/formats/ply.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;
using nlohmann::json;

TEST_CASE("cli: train --dim auto chooses N = 7, reduce makes the model smaller, and other commands read it",
          "[reduce]") {
  const TempFolder folder;
  put_scene(folder / "data", 32, 8, 3, "orbit");
  const json trained = json::parse(ubs_ok(folder,
                                          "train --data data --out run --dim auto --conditioning covariance "
                                          "--iterations 200 --init-points 300 "
                                          "--cap-max 350 --json")
                                       .out);
  CHECK(trained["dim"] == 7);
  CHECK_THAT(trained["data_report"]["notes"].dump(), Contains("\"dim auto: N = 7, 8 different times"));
  CHECK(get(folder / "run/config.yaml").find("dim: 7") != std::string::npos);

  const json reduced = json::parse(
      ubs_ok(
          folder,
          "reduce --model run/model.ply --data data --out r.ply --bound 0.1 --effects e.csv --json --quiet")
          .out);
  CHECK(reduced["before"]["splats"] == 350);
  CHECK(reduced["after"]["splats"] < 350);
  CHECK(reduced["after"]["bytes"] < reduced["before"]["bytes"]);
  CHECK(reduced["train"]["views"] == 8);
  CHECK(reduced["test"]["after"]["psnr"].get<double>() > 5);
  CHECK(get(folder / "e.csv").find("splat,dim,views,weight,opacity_range_3,") == 0);
  const MixedModel model = read_mixed_ply(folder / "r.ply");
  REQUIRE(model.mixed());
  CHECK(model.count() == reduced["after"]["splats"]);

  const json measured = json::parse(ubs_ok(folder, "eval --model r.ply --data data --json").out);
  CHECK(measured["mean"]["psnr"].get<double>() ==
        Approx(reduced["test"]["after"]["psnr"].get<double>()).margin(1e-9));
  CHECK(measured["groups"].size() == model.groups.size());
  ubs_ok(folder, "render --model r.ply --data data --out images --views 0");
  CHECK_THAT(ubs_ok(folder, "info r.ply").out, Contains("group of N ="));
  ubs_ok(folder, "gradients --model r.ply --data data --view 0 --out v.ply");
  CHECK(read_mixed_ply(folder / "v.ply").parameters() == model.parameters());
  const json planned = json::parse(ubs_ok(folder, "plan --model r.ply --data data --json").out);
  CHECK(planned["start"]["splats"] == model.count());
  ubs_ok(folder, "bench --model r.ply --data data --run model --min-time 0 --max-time 0.1 --json b.json");
  const json timed = json::parse(get(folder / "b.json"))["devices"][0]["cases"];
  REQUIRE(timed.size() == 1);  // models with several groups can only be rendered, so there is one case
  CHECK(timed[0]["name"].get<std::string>().starts_with("render.model."));
  CHECK(timed[0]["median_ms"].get<double>() > 0);
  check_error(folder, "compare --devices cpu --model r.ply --data data", 2, "splats of different dimensions");

  ubs_ok(folder, "convert r.ply copy.ply --to ubs");
  CHECK(get(folder / "copy.ply") == get(folder / "r.ply"));
  const json exported =
      json::parse(ubs_ok(folder, "convert r.ply g.splat --data data --time 0.5 --distill 0 --json").out);
  CHECK(exported["splats"].get<std::size_t>() <= model.count());
  CHECK(exported["splats"].get<std::size_t>() > 50);
  // The exported file has a single time and no direction, so its quality is lower, but it must still be
  // similar to the scene.
  CHECK(exported["psnr_after"].get<double>() > 5);
  CHECK(exported["psnr_before"].get<double>() > exported["psnr_after"].get<double>());
  for (const char* name : {"g.ply", "g.spz"})
    ubs_ok(folder, fmt::format("convert r.ply {} --distill 0", name));

  const json searched = json::parse(
      ubs_ok(folder, "reduce --model r.ply --data data --out s.ply --max-loss-db 0.5 --json --quiet").out);
  CHECK(searched["train"]["before"]["psnr"].get<double>() -
            searched["train"]["after"]["psnr"].get<double>() <=
        0.5);
  CHECK(searched["search"].size() == 9);
}

TEST_CASE("cli: reduce keeps a given number of splats, or as many as fit into a given size", "[reduce]") {
  const TempFolder folder;
  put_scene(folder / "data", 32, 8, 3, "orbit");
  ubs_ok(folder,
         "train data --out run --dim 7 --conditioning covariance --iterations 200 --init-points 300 "
         "--cap-max 350 --quiet");
  const Result few = ubs_ok(folder, "reduce run data --out few.ply --splats 0.1k --quiet");
  CHECK_THAT(few.out, Contains("few.ply: 100 of 350 splats, ") && Contains("PSNR of the test views"));
  CHECK(std::ranges::count(few.out, '\n') == 1);
  CHECK(read_mixed_ply(folder / "few.ply").count() == 100);

  const std::size_t whole = std::filesystem::file_size(folder / "run/model.ply");
  for (const double part : {0.9, 0.5, 0.2}) {
    const double megabytes = part * static_cast<double>(whole) / 1e6;
    ubs_ok(folder, fmt::format("reduce run data --out small.ply --size {} --quiet --overwrite", megabytes));
    const auto size = static_cast<double>(std::filesystem::file_size(folder / "small.ply"));
    CHECK(size <= 1e6 * megabytes);
    // A splat has at most 176 bytes, so much less than 1000 bytes of the size must be unused.
    CHECK(size > 1e6 * megabytes - 1000);
  }
  // More splats give a higher PSNR. If the model has fewer splats with an effect than --splats allows, the
  // result is that of a lossless reduction.
  const auto psnr = [&](const std::string& options) {
    return json::parse(ubs_ok(folder, "reduce run data --out x.ply --json --quiet --overwrite " + options)
                           .out)["train"]["after"]["psnr"]
        .get<double>();
  };
  CHECK(psnr("--splats 300") > psnr("--splats 100"));
  CHECK(psnr("--splats 400") == psnr("--lossless --only splats"));
  const Result table =
      ubs_ok(folder, "reduce run data --out x.ply --splats 300 --details --quiet --overwrite");
  CHECK_THAT(table.out, Contains("train PSNR [dB]") && Contains("render [ms]") && Contains("x.ply: 300 of"));
}

TEST_CASE("cli: for a model with direct conditioning, reduce only removes splats and reports this",
          "[reduce]") {
  const TempFolder folder;
  put_scene(folder / "data", 32, 8, 3, "orbit");
  ubs_ok(folder, "train data --out run --iterations 200 --init-points 300 --cap-max 350 --quiet");
  const Result reduced = ubs_ok(folder, "reduce run data --out r.ply --bound 0.1 --quiet");
  CHECK_THAT(reduced.err, Contains("only splats are removed") && Contains("conditioning direct"));
  const MixedModel model = read_mixed_ply(folder / "r.ply");
  CHECK_FALSE(model.mixed());
  CHECK(model.count() < 350);
}

TEST_CASE("cli: reduce rejects invalid arguments", "[reduce]") {
  const TempFolder folder;
  put_scene(folder / "data", 16, 2, 1);
  SplatModel nothing(6, 3);
  for (std::size_t i = 0; i < 3; ++i) nothing.row(nothing.layout().opacity)[i] = -200;
  write_splat_ply(folder / "m.ply", nothing);
  const auto refused = [&](const std::string& arguments, int code, const std::string& reason) {
    const Result result = run_ubs(folder, "reduce --quiet --data data " + arguments);
    INFO(arguments << "\n" << result.err);
    CHECK(result.code == code);
    CHECK_THAT(result.err, Contains(reason));
    CHECK(!std::filesystem::exists(folder / "r.ply"));
  };
  refused("--model m.ply --out r.ply --lossless", 3, "no splat would remain");
  refused("--model m.ply --out m.ply", 2, "this is the input m.ply");
  refused("--model m.ply --out r.ply --lossless --bound 0.1", 2, "cannot be combined");
  refused("--model none.ply --out r.ply", 3, "none.ply");
  refused("--model m.ply --out r.ply --bound 2", 2, "bound");
  refused("--model m.ply --out r.ply --splats 2 --size 1", 2, "cannot be combined");
  refused("--model m.ply --out r.ply --splats none", 2, "--splats none: expected a whole number from 1");
  refused("--model m.ply --out r.ply --splats 0", 2, "expected a whole number from 1");
  refused("--model m.ply --out r.ply --splats 2 --only dimensions", 2, "--splats removes splats");
  refused("--model m.ply --out r.ply --size 0", 2, "size");
}
