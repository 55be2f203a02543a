// SPDX-License-Identifier: Apache-2.0
// Tests that run `ubs-lab bench` as a process. They check the names and the selection of cases, the written
// files, the comparison with a baseline, and the exit codes.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

using nlohmann::json;
using test::get;
using test::put;
using test::put_scene;
using test::Result;
using test::run_ubs;
using test::TempFolder;

std::size_t lines(const std::string& text) {
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

TEST_CASE("bench: --list prints the cases that --run selects") {
  const TempFolder folder;
  const Result all = run_ubs(folder, "bench --list");
  CHECK(all.code == 0);
  CHECK(all.out.find("adam.synthetic.30K.200x200\n") != std::string::npos);
  const Result some = run_ubs(folder, "bench --list --run '^(adam|render).random'");
  CHECK(lines(some.out) == 4);
  CHECK(run_ubs(folder, "bench --list --sizes 320x240/5K --run '^adam.synthetic'").out ==
        "adam.synthetic.5K.320x240\n");
  CHECK(run_ubs(folder, "bench --run nosuchcase").code == 2);
  CHECK(run_ubs(folder, "bench --list --model m.ply").code == 3);  // the file does not exist
  put(folder / "m.ply", "a model");
  CHECK(run_ubs(folder, "bench --list --model m.ply").code == 2);  // --model requires --data
  CHECK(run_ubs(folder, "bench --run adam --baseline absent.json").code == 3);
}

TEST_CASE("bench: results are written as JSON, and the exit code is 8 if they are slower than the baseline") {
  const TempFolder folder;
  const std::string run = "bench --quick --run '(adam|raster_forward|iteration|render).synthetic' ";
  const Result first = run_ubs(folder, run + "--json a.json");
  INFO(first.err);
  REQUIRE(first.code == 0);
  json file = json::parse(get(folder / "a.json"));
  for (const char* key : {"version", "build", "date", "command", "host"}) CHECK(file.at(key).is_string());
  CHECK(file["command"].get<std::string>().find("--quick") != std::string::npos);
  REQUIRE(file["devices"].size() == 1);
  const json& device = file["devices"][0];
  REQUIRE(device["cases"].size() == 4);
  for (const json& c : device["cases"]) {
    CHECK(c["median_ms"] > 0);
    CHECK(c["minimum_ms"] <= c["median_ms"]);
    CHECK(c["device_ms"] > 0);
    CHECK(c["peak_bytes"] > 0);
    CHECK(first.out.find(c["name"].get<std::string>()) != std::string::npos);
  }
  // Compares with two baselines without any uncertainty. In the first, every case took a hundredth of the
  // time. In the second, every case took a hundred times as long.
  for (const double factor : {0.01, 100.0}) {
    json doctored = file;
    for (json& c : doctored["devices"][0]["cases"]) {
      c["median_ms"] = factor * c["median_ms"].get<double>();
      c["minimum_ms"] = factor * c["minimum_ms"].get<double>();
      c["uncertainty"] = 0;
    }
    put(folder / "old.json", doctored.dump());
    const Result compared = run_ubs(folder, run + "--max-time 0.2 --baseline old.json");
    CHECK(compared.code == (factor < 1 ? 8 : 0));
    CHECK(compared.out.find(factor < 1 ? "SLOWER" : "faster") != std::string::npos);
  }
  json other = file;
  for (json& c : other["devices"][0]["cases"]) c["name"] = "another";
  put(folder / "old.json", other.dump());
  const std::string one = "bench --quick --run adam.synthetic ";
  const Result apart = run_ubs(folder, one + "--baseline old.json");
  CHECK(apart.code == 3);  // earlier versions accepted a baseline without any case of the run
  CHECK(apart.err.find("the baseline contains no case of this run") != std::string::npos);
  put(folder / "old.json", "{}");
  CHECK(run_ubs(folder, one + "--baseline old.json").code == 3);
}

TEST_CASE("bench: an interrupted run saves its results so far and exits with 130") {
  const TempFolder folder;
  // The signal is sent when the first of four cases is finished. Without -m, bash would start the background
  // process with SIGINT ignored.
  put(folder / "run.sh",
      fmt::format("'{}' bench --run '^iteration.*synthetic' --sizes 64x64/1K --min-time 1 --max-time 1 "
                  "--json a.json >out & pid=$!\n"
                  "for i in $(seq 6000); do grep -q ^iteration out && break; sleep 0.1; done\n"
                  "kill -INT $pid; wait $pid; echo $? >code\n",
                  UBS_LAB_EXECUTABLE));
  REQUIRE(std::system(fmt::format("cd '{}' && bash -m run.sh 2>/dev/null", folder.path().string()).c_str()) ==
          0);
  CHECK(get(folder / "code") == "130\n");
  const json cases = json::parse(get(folder / "a.json"))["devices"][0]["cases"];
  CHECK(cases.size() >= 1);
  CHECK(cases.size() < 4);
}

TEST_CASE("bench: a model with its data is measured, and a device that is listed twice is used twice") {
  const TempFolder folder;
  put_scene(folder / "data", 32, 8, 2);
  REQUIRE(
      run_ubs(folder, "train --data data --out run --iterations 20 --init-points 300 --cap-max 300").code ==
      0);
  const Result two = run_ubs(
      folder, "bench --quick --device 0,0 --run '^adam.(synthetic|model)' --model run/model.ply --data data");
  CHECK(two.code == 0);
  CHECK(two.out.find("adam.model.300.32x32") != std::string::npos);
  CHECK(two.out.find("[1]") != std::string::npos);
}

TEST_CASE("bench: data of other layouts and models of other variants are measured") {
  const TempFolder folder;
  put_scene(folder / "data", 32, 8, 2);
  ubs_ok(folder, "pack data --out d.ubsd");
  ubs_ok(
      folder,
      "train --data d.ubsd --out run --dim 3 --kernel gaussian --colour sh1 --iterations 5 --init-points 300 "
      "--cap-max 300");
  const Result own = ubs_ok(folder,
                            "bench --quick --run '^(iteration|raster_forward).model' --model run/model.ply "
                            "--data d.ubsd --set background=0,0,0 --json m.json");
  CHECK(own.out.find("raster_forward.model.300.32x32") != std::string::npos);
  CHECK(own.out.find("kernel gaussian, colour sh1") != std::string::npos);
  CHECK(json::parse(get(folder / "m.json"))["devices"][0]["cases"][0]["form"] ==
        "kernel gaussian, colour sh1");
  ubs_ok(folder, "bench --quick --device opencl --run '^lists' --set math=native --json t.json");
  const json report = json::parse(get(folder / "t.json"));
  CHECK(report["math"] == "native");
  // The settings also apply to single stages: without gradients of rgb, a stage needs less memory.
  const auto adam_bytes = [&](const std::string& options) {
    ubs_ok(folder, "bench --quick --device opencl --run adam.synthetic --overwrite --json a.json" + options);
    return json::parse(get(folder / "a.json"))["devices"][0]["cases"][0]["peak_bytes"].get<std::uint64_t>();
  };
  CHECK(adam_bytes(" --set freeze=rgb") < adam_bytes(""));
  check_error(folder, "bench --quick --run adam.synthetic --set kernel=gaussian --json n.json", 2,
              "'synthetic'");
}

TEST_CASE("train: memory is predicted and reported") {
  const TempFolder folder;
  put_scene(folder / "data", 48, 8, 2);
  const Result run =
      run_ubs(folder, "train --data data --out run --iterations 100 --init-points 2000 --cap-max 3000");
  REQUIRE(run.code == 0);
  CHECK(run.out.find("memory   predicted ") != std::string::npos);
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  // The ratio observed on PoCL is 1.00.
  CHECK(metrics["peak_device_bytes"].get<double>() / metrics["predicted_device_bytes"].get<double>() ==
        Approx(1).epsilon(0.03));
}

}  // namespace
}  // namespace ubs
