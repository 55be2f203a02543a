// SPDX-License-Identifier: Apache-2.0
// Runs the executable to test plans, budgets, checkpoints, evaluations, and training on wide images.
// resume_test.cpp tests runs that are killed or interrupted.
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "tests/support/images.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using nlohmann::json;
using test::check_error;
using test::ended_by;
using test::get;
using test::put;
using test::put_scene;
using test::replaced;
using test::Result;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

// Runs a shell script in the folder. Uses bash -m, because otherwise background jobs ignore SIGINT. Discards
// the message of bash about a missing terminal.
Result shell(const TempFolder& folder, const std::string& script) {
  const std::string path = folder.path().string();
  put(folder / "run.sh", fmt::format("cd '{0}'\nexec >'{0}/stdout.txt' 2>'{0}/stderr.txt'\nubs='{1}'\n{2}\n",
                                     path, UBS_EXECUTABLE, script));
  const int status = std::system(fmt::format("bash -m '{}/run.sh' 2>/dev/null </dev/null", path).c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, get(folder / "stdout.txt"),
          get(folder / "stderr.txt")};
}

void synthesise(const TempFolder& folder) { put_scene(folder / "data", 32, 8, 2); }

TEST_CASE("cli: views of wide images have no opacity penalty unless the user sets one") {
  const TempFolder folder;
  test::put_panoramas(folder / "data", 3);
  const auto penalty = [&](const std::string& out) {
    return json::parse(get(folder / out / "metrics.json"))["settings"]["opacity_reg"].get<double>();
  };
  const std::string train = "train --data data --quiet --dim 3 --init-points 50 --cap-max 100 --out ";
  ubs_ok(folder, train + "a --iterations 2");
  CHECK(penalty("a") == 0);
  // The test image is divided into six pinhole views. The mean of the metrics contains this image only once.
  // It is measured with its own lens, and with its fitted exposure and pose.
  ubs_ok(folder, train + "d --iterations 2 --refine-cameras pose --appearance gain --test-every 3");
  const json test = json::parse(get(folder / "d/metrics.json"))["test"];
  CHECK(test["views"].size() == 6);
  REQUIRE(test["wide_images"].size() == 1);
  for (const char* part : {"fitted", "fitted_pose"}) {
    REQUIRE(test["wide_images"][0].contains(part));
    CHECK(test["mean"][part] == test["wide_images"][0][part]);
  }
  CHECK(ended_by(folder, train + "b --budget 1h", SIGTERM, "b/log.csv") == 130);  // interrupted early
  CHECK(penalty("b") == 0);
  // Settings that the user chose are kept when the run is resumed.
  const std::string start =
      "\"$ubs\" " + train + "c --iterations 1000000 --opacity-reg 0.01 --checkpoint-every 5";
  for (const std::string& command : {start, std::string("\"$ubs\" train --resume c --quiet")}) {
    const Result stopped = shell(folder, "touch c.before; " + command +
                                             " & pid=$!\nuntil [ -e c/checkpoint.ubs ] && ! cmp -s "
                                             "c.before c/checkpoint.ubs; do sleep 0.1; done\n"
                                             "kill -TERM $pid; wait $pid; code=$?\n"
                                             "cp c/checkpoint.ubs c.before; exit $code");
    INFO(command << ": " << stopped.err);
    CHECK(stopped.code == 130);
    CHECK(penalty("c") == 0.01);
  }
}

TEST_CASE("cli: a full disk does not end a run") {
  const TempFolder folder;
  synthesise(folder);
  // A limit for the size of files simulates a full disk: files larger than 2 MiB cannot be written. With 8000
  // splats, a checkpoint needs 3.4 MB, and the model needs 1.1 MB.
  const Result result =
      shell(folder,
            "trap '' XFSZ; ulimit -f 2048; exec \"$ubs\" train --data data --out run --quiet "
            "--init-points 8000 --cap-max 8000 --iterations 250 --checkpoint-every 100");
  INFO(result.err);
  CHECK(result.err.find("could not write the checkpoint at iteration 100") != std::string::npos);
  CHECK(result.err.find("could not write the checkpoint at iteration 200") != std::string::npos);
  CHECK(result.err.find("disk full?") != std::string::npos);
  CHECK(result.code == 0);
  CHECK(fs::exists(folder / "run/model.ply"));
}

TEST_CASE("cli: a checkpoint that is older than the model neither becomes continue.ubs nor replaces it") {
  const TempFolder folder;
  synthesise(folder);
  // The run starts with 300 splats and reaches 16000, whose checkpoint of 3.3 MB is larger than the limit for
  // the size of files, which simulates a full disk.
  const std::string train =
      "train --data data --out run --quiet --init-points 300 --cap-max 16000 --dim 3 --set growth=1.8 "
      "--set refine=0:30000:1500 --save-renders 0 --iterations 200 --checkpoint-every 10";
  const Result full = shell(folder, "trap '' XFSZ; ulimit -f 2048; exec \"$ubs\" " + train);
  INFO(full.err);
  REQUIRE(full.code == 0);
  CHECK_THAT(full.err, Contains("the checkpoint of iteration ") &&
                           Contains("is older than the results, and was removed"));
  CHECK_FALSE(fs::exists(folder / "run/checkpoint.ubs"));
  CHECK_FALSE(fs::exists(folder / "run/continue.ubs"));
  const std::string model = get(folder / "run/model.ply");
  check_error(folder, "train --resume run --budget +2s", 2, "it has no continue.ubs");

  // An older checkpoint that comes back, for example from a backup, is refused.
  ubs_ok(folder,
         replaced(replaced(train, "--out run", "--out short"), "--iterations 200", "--iterations 20"));
  fs::copy_file(folder / "short/continue.ubs", folder / "short/checkpoint.ubs");
  json metrics = json::parse(get(folder / "short/metrics.json"));
  metrics["iterations"] = 200;
  put(folder / "short/metrics.json", metrics.dump());
  for (const char* file : {"checkpoint.ubs", "continue.ubs"}) {
    check_error(folder, "train --resume short --budget +2s", 2,
                "this checkpoint is of iteration 20, but the model in this folder is of iteration 200");
    fs::remove(folder / "short" / file);
  }
  CHECK(get(folder / "run/model.ply") == model);
}

TEST_CASE("cli: a run whose folder is removed or replaced ends, and writes nothing to the new folder") {
  const TempFolder folder;
  synthesise(folder);
  for (const std::string replace :
       {"mkdir run", "mkdir other; echo mine >other/model.ply; ln -s other run"}) {
    const Result result =
        shell(folder,
              "\"$ubs\" train --data data --out run --quiet --init-points 50 --cap-max 60 --dim 3 "
              "--iterations 1000000 --checkpoint-every 5 & pid=$!\n"
              "until [ -e run/checkpoint.ubs ]; do sleep 0.1; done\n"
              "mv run away; " +
                  replace + "; wait $pid");
    INFO(result.err);
    CHECK(result.code == 3);
    CHECK_THAT(result.err, Contains("run: this folder was removed or replaced while this process was") &&
                               !Contains("--resume"));
    const bool link = fs::is_symlink(folder / "run");
    CHECK(test::file_count(folder / "run") == (link ? 1 : 0));
    if (link) CHECK(get(folder / "other/model.ply") == "mine\n");
    for (const char* name : {"run", "away"}) fs::remove_all(folder / name);
  }
}

TEST_CASE("cli: plan estimates the time and memory of a run, and the run records the actual values") {
  const TempFolder folder;
  synthesise(folder);
  const std::string options = "--data data --iterations 1000 --init-points 300 --cap-max 500";
  const Result text = run_ubs(folder, "plan " + options);
  INFO(text.err);
  REQUIRE(text.code == 0);
  for (const char* part : {"-DUBS_N=6", "raster_forward", "memory at the end", "intersections",
                           "1000 iterations at the measured"})
    CHECK(text.out.find(part) != std::string::npos);
  CHECK(test::file_count(folder.path()) == 3);  // data, stdout.txt and stderr.txt: plan writes no files
  const json plan = json::parse(run_ubs(folder, "plan --json " + options).out);
  CHECK(plan["start"]["splats"] == 300);
  CHECK(plan["end"]["splats"] == 500);
  CHECK(plan["memory"]["total_bytes"].get<double>() > 0);
  CHECK(plan["stages"].size() == 14);

  const Result run = run_ubs(folder, "train --out run " + options);
  INFO(run.err);
  REQUIRE(run.code == 0);
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  for (const char* key : {"seconds", "step_ms", "most_intersections", "memory_bytes"})
    CHECK(metrics["actual"][key].get<double>() > 0);
  const json drawing =
      json::parse(run_ubs(folder, "plan --json --model run/model.ply --data data --depth").out);
  CHECK(drawing["start"]["splats"] == 500);
  CHECK(drawing["iterations"] == 0);

  check_error(folder, "plan --data nowhere", 3, "nowhere: no such data folder");
  check_error(folder, "plan --data data --dim 12", 2, "dim");
  check_error(folder, "plan --data data --model none.ply", 3, "none.ply");
  check_error(folder, "plan --data data --cap-max 100000000", 6, "MiB");
}

TEST_CASE("cli: a run with a time budget records settings that reproduce it") {
  const TempFolder folder;
  // The minimum of 100 iterations takes an eighth of a second on two cores of an AMD EPYC, so it fits into
  // the budget even on a slow machine.
  put_scene(folder / "data", 64, 6, 2);
  const std::string of_time = "train --data data --cap-max 700 --dim 3 --budget ";
  const Result run = ubs_ok(folder, of_time + "20s --out run --eval-every 400 --checkpoint-every 300");
  const std::string config = get(folder / "run/config.yaml");
  for (const char* part : {"steps    being measured", "schedule ", " that are left of 20"})
    CHECK_THAT(run.out, Contains(part));
  for (const char* part : {"pyramid: '4:0.", "cap_max: 700", "lr_scale: 0.0", "\nwork_shares: '", ":1'"})
    CHECK_THAT(config, Contains(part));
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  CHECK(metrics["iterations"] == metrics["settings"]["iterations"]);
  CHECK(metrics["iterations"].get<int>() >= 100);
  CHECK(metrics["budget_seconds"] == 20);
  // The budget contains the time before the first iteration.
  const double preparation = 60 * metrics["minutes"]["stages"]["preparation"].get<double>();
  CHECK(preparation > 0);
  CHECK(preparation <= metrics["preparation_seconds"].get<double>());
  CHECK(preparation < metrics["seconds"].get<double>());
  // A run with the recorded settings gives the same result. It has no budget, so its recorded time does not
  // include the preparation.
  ubs_ok(folder, "train --data data --out again --spec run/config.yaml --quiet");
  CHECK_FALSE(json::parse(get(folder / "again/metrics.json"))["minutes"]["stages"].contains("preparation"));
  const bool same = get(folder / "run/model.ply") == get(folder / "again/model.ply");
  CHECK(same);
  // The recorded settings are only valid with the run's own number of iterations.
  check_error(folder, "train --data data --out x --spec run/config.yaml --iterations 99999", 2,
              "does not match iterations");
  check_error(folder, "train --data data --out x --budget soon", 2, "90s");
  check_error(folder, "train --data data --out x --budget 1ms", 2, "90s");
  // Settings that the user passes are kept, even if they equal the default.
  std::ofstream(folder / "own.yaml") << "growth: 1.02\n";
  const std::string own_settings = "--dim 3 --cap-max 300000 --set lr_xyz=1.6e-4 --spec own.yaml";
  CHECK(ended_by(folder, fmt::format("train data --out own --budget 1h {}", own_settings), SIGTERM,
                 "own/log.csv") == 130);
  const std::string own = get(folder / "own/config.yaml");
  for (const char* part : {"\ncap_max: 300000", "\nlr_xyz: 0.00016", "\ngrowth: 1.02 "})
    CHECK_THAT(own, Contains(part));
  const Result hopeless = run_ubs(folder, "train --data data --out x --budget 0.001s");
  CHECK(hopeless.code == 2);
  CHECK_THAT(hopeless.err, Contains("increase the budget"));
  CHECK_FALSE(fs::exists(folder / "x/model.ply"));
  // Errors of the command line are reported before the data are read, which would fail here.
  put(folder / "bad/transforms.json", "no JSON");
  check_error(folder, "train bad --out x", 3, "bad/transforms.json");
  check_error(folder, "train bad --out x --device nonesuch", 4, "'nonesuch' matches no device");
  check_error(folder, "train bad --out x --budget 2ms", 2, "90s");
  check_error(folder, "train bad --out x --budget 0.01s", 2, "increase the budget");
  check_error(folder, "train bad --out x --cap-max none", 2, "cap_max");
  check_error(folder, "train --data data --out x --budget 9s --iterations 100", 2,
              "remove --budget or --iterations");
  put(folder / "published.yaml", "iterations: 100\n");
  check_error(folder, "train --data data --out x --budget 9s --spec published.yaml", 2,
              "in a file of settings, the line 'iterations'");
  check_error(folder, "train --resume own --budget 9s", 2, "--budget +9s");
  check_error(folder, "train --resume own --budget +soon", 2, "90s");
  // The interrupted run `own` is completed with a budget of one more second. Its settings then contain the
  // complete schedule.
  const int so_far = json::parse(get(folder / "own/metrics.json"))["iterations"].get<int>();
  const Result completed = ubs_ok(folder, "train --resume own --budget +1s");
  const std::string shares = get(folder / "own/config.yaml");
  CHECK_THAT(shares, Contains(fmt::format("{}:", so_far)) && Contains(":1'"));
  CHECK_THAT(completed.out, Contains("finished after"));
  CHECK_FALSE(fs::exists(folder / "own/checkpoint.ubs"));
  check_error(folder, "train --data data --out x --pyramid 2:0.5,4:0.7", 2, "FACTOR:SHARE");
}

TEST_CASE("cli: --eval-every accepts iterations and seconds, and the last iteration is always evaluated") {
  const TempFolder folder;
  put_scene(folder / "data", 16, 2, 1);
  const auto evaluations = [&](const std::string& interval) {
    ubs_ok(folder,
           "train data --out run --overwrite --quiet --dim 3 --iterations 12 --init-points 20 "
           "--log-every 1 --eval-every " +
               interval);
    std::istringstream log(get(folder / "run/log.csv"));
    std::string line;
    int count = 0;
    // A row with ",,," has metrics neither of all test views nor of a sample of them.
    while (std::getline(log, line)) count += line.find(",,,") == std::string::npos;
    return count - 1;  // without the header line
  };
  CHECK(evaluations("0") == 1);
  CHECK(evaluations("5") == 3);
  CHECK(evaluations("1e-9s") == 12);  // each iteration takes longer than this interval
  CHECK(evaluations("1000s") == 1);
}

}  // namespace
}  // namespace ubs
