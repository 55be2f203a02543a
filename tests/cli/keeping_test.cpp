// SPDX-License-Identifier: Apache-2.0
// Plans, checkpoints and the guard as a user of the executable meets them.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>

#include "host/data/blender.hpp"
#include "host/train/checkpoint.hpp"
#include "tests/support/data.hpp"
#include "tests/support/images.hpp"
#include "tests/support/lenient_kernels.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using nlohmann::json;
using test::check_error;
using test::get;
using test::put;
using test::put_scene;
using test::Result;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

// bash -m: otherwise background jobs have SIGINT ignored; what it says about missing terminals is not of
// interest.
Result shell(const TempFolder& folder, const std::string& script) {
  const std::string path = folder.path().string();
  put(folder / "run.sh", fmt::format("cd '{0}'\nexec >'{0}/stdout.txt' 2>'{0}/stderr.txt'\nubs='{1}'\n{2}\n",
                                     path, UBS_EXECUTABLE, script));
  const int status = std::system(fmt::format("bash -m '{}/run.sh' 2>/dev/null </dev/null", path).c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, get(folder / "stdout.txt"),
          get(folder / "stderr.txt")};
}

constexpr const char* kRun =
    "--data data --init-points 300 --cap-max 350 --log-every 50 --save-renders 0 --quiet "
    "--iterations 1500";

void synthesise(const TempFolder& folder) { put_scene(folder / "data", 32, 8, 2); }

// Starts the run, whose kernels may have to be compiled first, and sends `signal` when there is a checkpoint
// (KILL) or a log (INT, TERM).
int interrupted_run(const TempFolder& folder, const std::string& out, const char* signal,
                    const std::string& more) {
  const std::string wanted = std::string(signal) == "KILL" ? "checkpoint.ubs" : "log.csv";
  const Result result =
      shell(folder, fmt::format("\"$ubs\" train {} --out {} {} & pid=$!\n"
                                "for i in $(seq 30000); do [ -s {}/{} ] && break; sleep 0.02; done\n"
                                "sleep 0.1; kill -{} $pid; wait $pid 2>/dev/null\nexit $?",
                                kRun, out, more, out, wanted, signal));
  return result.code;
}

TEST_CASE("cli: a run that was killed or interrupted is continued to the same bytes") {
  const TempFolder folder;
  synthesise(folder);
  REQUIRE(run_ubs(folder, fmt::format("train {} --out whole", kRun)).code == 0);
  CHECK_FALSE(fs::exists(folder / "whole/checkpoint.ubs"));

  interrupted_run(folder, "killed", "KILL", "--checkpoint-every 100");
  REQUIRE(fs::exists(folder / "killed/checkpoint.ubs"));
  CHECK_FALSE(fs::exists(folder / "killed/model.ply"));
  check_error(folder, fmt::format("train {} --out killed", kRun), 2, "--resume killed");
  const std::regex says("With 0 a\\s+checkpoint is\\s+written only when the run is\\s+interrupted");
  CHECK(std::regex_search(get(UBS_SOURCE_DIR "/docs/training.md"), says));
  CHECK(interrupted_run(folder, "interrupted", "INT", "--checkpoint-every 0") == 130);
  CHECK(interrupted_run(folder, "terminated", "TERM", "") == 130);
  for (const char* out : {"killed", "interrupted", "terminated"}) {
    INFO(out);
    const Result result = run_ubs(folder, fmt::format("train --resume {} --quiet", out));
    INFO(result.err);
    REQUIRE(result.code == 0);
    CHECK(get(folder / out / "model.ply") == get(folder / "whole/model.ply"));
    CHECK(test::without_seconds(get(folder / out / "log.csv")) ==
          test::without_seconds(get(folder / "whole/log.csv")));
    CHECK_FALSE(fs::exists(folder / out / "checkpoint.ubs"));
    const json metrics = json::parse(get(folder / out / "metrics.json"));
    CHECK(metrics["resumed_from"].get<int>() > 0);
    CHECK(metrics["interrupted"] == false);
    CHECK_THAT(metrics["data_report"].dump(), !Contains("random positions"));  // nothing begins
  }
  check_error(folder, "train --resume whole", 2, "this run is finished");
}

TEST_CASE("cli: the checkpoint of another run is not continued in this one's folder") {
  const TempFolder folder;
  synthesise(folder);
  REQUIRE(interrupted_run(folder, "a", "TERM", "--checkpoint-every 60") == 130);
  REQUIRE(interrupted_run(folder, "same", "TERM", "--checkpoint-every 60") == 130);  // settings and data too
  REQUIRE(interrupted_run(folder, "other", "TERM", "--checkpoint-every 60 --seed 5") == 130);
  const std::string own = get(folder / "a/checkpoint.ubs"), config = get(folder / "a/config.yaml");
  for (const std::string from : {"same", "other"}) {
    fs::copy_file(folder / (from + "/checkpoint.ubs"), folder / "a/checkpoint.ubs",
                  fs::copy_options::overwrite_existing);
    const std::string log = get(folder / "a/log.csv");
    check_error(folder, "train --resume a --quiet", 3,
                "a/checkpoint.ubs: belongs to another run than log.csv");
    CHECK(get(folder / "a/log.csv") == log);
    CHECK(get(folder / "a/config.yaml") == config);
  }
  fs::remove(folder / "a/log.csv");
  check_error(folder, "train --resume a --quiet", 3,
              "another run than config.yaml beside it (cannot resume with seed = 5");
  put(folder / "a/checkpoint.ubs", own);
  CHECK(run_ubs(folder, "train --resume a --quiet").code == 0);
  // Alone in a folder a checkpoint is all that a run needs.
  fs::create_directories(folder / "new");
  fs::copy_file(folder / "other/checkpoint.ubs", folder / "new/checkpoint.ubs");
  CHECK(run_ubs(folder, "train --resume new --quiet").code == 0);
}

TEST_CASE("cli: views of wide images have no opacity penalty unless somebody chooses one") {
  const TempFolder folder;
  json data{{"camera_model", "EQUIRECTANGULAR"}, {"w", 128}, {"h", 64}, {"frames", json::array()}};
  for (int i = 0; i < 3; ++i) {
    const std::string name = fmt::format("{}.png", i);
    test::put_image(folder / "data" / name, 128, 64, 40 * i);
    data["frames"].push_back(
        {{"file_path", name},
         {"transform_matrix", {{1, 0, 0, 0.1 * i}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}}});
  }
  put(folder / "data/transforms.json", data.dump());
  const auto penalty = [&](const std::string& out) {
    return json::parse(get(folder / out / "metrics.json"))["settings"]["opacity_reg"].get<double>();
  };
  const std::string train = "train --data data --quiet --dim 3 --init-points 50 --cap-max 100 --out ";
  ubs_ok(folder, train + "a --iterations 2");
  CHECK(penalty("a") == 0);
  ubs_ok(folder, train + "b --budget 4s");
  CHECK(penalty("b") == 0);
  // What was chosen stays when the run is continued.
  const std::string start =
      "\"$ubs\" " + train + "c --iterations 100000 --opacity-reg 0.01 --checkpoint-every 5";
  for (const std::string& command : {start, std::string("\"$ubs\" train --resume c --quiet")}) {
    const Result stopped = shell(folder, "touch c.before; " + command +
                                             " & pid=$!\nuntil [ -e c/checkpoint.ubs ] && ! cmp -s "
                                             "c.before c/checkpoint.ubs; do sleep 0.1; done\n"
                                             "kill -INT $pid; wait $pid; code=$?\n"
                                             "cp c/checkpoint.ubs c.before; exit $code");
    INFO(command << ": " << stopped.err);
    CHECK(stopped.code == 130);
    CHECK(penalty("c") == 0.01);
  }
}

TEST_CASE("cli: what cannot be continued is one line") {
  const TempFolder folder;
  synthesise(folder);
  REQUIRE(interrupted_run(folder, "run", "INT", "--refine-cameras pose") == 130);
  CHECK(json::parse(get(folder / "run/cameras/transforms.json"))["frames"].size() == 8);
  check_error(folder, "train --resume nowhere", 3, "no checkpoint.ubs");
  check_error(folder, "train --resume run --out other", 2, "remove --out");
  check_error(folder, "train --resume run --lr-rgb 0.5", 2,
              "cannot resume with lr_rgb = 0.5: the run was started with lr_rgb = auto");
  check_error(folder, "train --resume run --iterations 9000", 2, "its schedule depends on");
  put_scene(folder / "other", 32, 8, 2, "cloud");
  check_error(folder, "train --resume run --data other --quiet", 3,
              "differ from those that the run was started with");
  const std::string bytes = get(folder / "run/checkpoint.ubs");
  put(folder / "run/checkpoint.ubs", bytes.substr(0, bytes.size() - 100));
  check_error(folder, "train --resume run", 3, "truncated checkpoint");
  std::string damaged = bytes;
  damaged[bytes.size() - 1000] ^= 1;
  put(folder / "run/checkpoint.ubs", damaged);
  check_error(folder, "train --resume run", 3, "CRC-32");
  put(folder / "run/checkpoint.ubs", bytes);
  CHECK(run_ubs(folder, "train --resume run --quiet --save-renders 1").code == 0);
}

TEST_CASE("cli: a full disk does not end a run") {
  const TempFolder folder;
  synthesise(folder);
  // Files above 2 MiB cannot be written: checkpoints of 8000 splats need 3.4, the model 1.1.
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

// Finite parameters whose gradient is not: a large splat half way to the first camera, with colours of 1e38,
// whose squares SSIM takes.
void make_glaring(const fs::path& checkpoint, const fs::path& data) {
  Checkpoint c = read_checkpoint(checkpoint);
  const std::array<double, 3> centre = load_blender_split(data, "train").views[0].camera.centre();
  SplatModel& model = c.state.model;
  for (int r = 0; r < 3; ++r) model.row(r)[7] = static_cast<float>(0.5 * centre[static_cast<std::size_t>(r)]);
  for (int r = 3; r < 6; ++r) model.row(r)[7] = 1e38f;
  model.row(6)[7] = 10;
  for (int r = 8; r < 11; ++r) model.row(r)[7] = -8;
  for (int r = 14; r < 17; ++r) model.row(r)[7] = -1;
  fs::remove(checkpoint);
  write_checkpoint(checkpoint, c);
}

TEST_CASE("cli: a value that is not finite stops with 7 and names iteration and stage") {
  const test::LenientKernels kernels;
  const TempFolder folder;
  synthesise(folder);
  REQUIRE(interrupted_run(folder, "run", "INT", "") == 130);
  make_glaring(folder / "run/checkpoint.ubs", folder / "data");
  const std::string bytes = get(folder / "run/checkpoint.ubs");
  const Result result = run_ubs(folder, "train --resume run --quiet");
  INFO(result.err);
  REQUIRE(result.code == 7);
  CHECK(result.err.find("ubs: error: values that are not finite at iteration") != std::string::npos);
  CHECK(result.err.find("was saved: resume with 'ubs train --resume run'") != std::string::npos);
  CHECK(get(folder / "run/checkpoint.ubs") == bytes);
  CHECK(
      (test::contains(result.err, "stage image_loss") || test::contains(result.err, "stage raster_forward")));
  // Without the splat the run comes to its end, unless by where it was interrupted others are as bad.
  const Result dropped = run_ubs(folder, "train --resume run --quiet --on-nan drop");
  INFO(dropped.err);
  const bool refused = test::contains(dropped.err, "would have been dropped");
  CHECK(dropped.code == (refused ? 7 : 0));
  CHECK(fs::exists(folder / "run/checkpoint.ubs") == refused);
}

TEST_CASE("cli: plan says what a run needs, and the run says what it took") {
  const TempFolder folder;
  synthesise(folder);
  const std::string options = "--data data --iterations 1000 --init-points 300 --cap-max 500";
  const Result text = run_ubs(folder, "plan " + options);
  INFO(text.err);
  REQUIRE(text.code == 0);
  for (const char* part : {"-DUBS_N=6", "raster_forward", "memory at the end", "intersections",
                           "1000 iterations at the measured"})
    CHECK(text.out.find(part) != std::string::npos);
  CHECK(test::file_count(folder.path()) == 3);  // data, stdout.txt, stderr.txt: nothing was made
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

TEST_CASE("cli: a budget becomes settings that repeat the run") {
  const TempFolder folder;
  put_scene(folder / "data", 128, 6, 2);
  const std::string of_time = "train --data data --cap-max 700 --dim 3 --budget ";
  const Result run = ubs_ok(folder, of_time + "20s --out run --eval-every 40 --checkpoint-every 30");
  const std::string config = get(folder / "run/config.yaml");
  for (const char* part : {"schedule ", " iterations in 20 s", "steps measured in"})
    CHECK_THAT(run.out, Contains(part));
  for (const char* part : {"pyramid: '4:0.", "cap_max: 700", "lr_scale: 0.0", "\nwork_shares: '", ":1'"})
    CHECK_THAT(config, Contains(part));
  const json metrics = json::parse(get(folder / "run/metrics.json"));
  CHECK(metrics["iterations"] == metrics["settings"]["iterations"]);
  CHECK(metrics["iterations"].get<int>() >= 100);
  CHECK(metrics["budget_seconds"] == 20);
  // The same from its settings.
  ubs_ok(folder, "train --data data --out again --spec run/config.yaml --quiet");
  const bool same = get(folder / "run/model.ply") == get(folder / "again/model.ply");
  CHECK(same);
  // What is recorded belongs to the run's own number of iterations.
  check_error(folder, "train --data data --out x --spec run/config.yaml --iterations 99999", 2,
              "belongs to a number of iterations");
  check_error(folder, "train --data data --out x --budget soon", 2, "90s");
  check_error(folder, "train --data data --out x --budget 1ms", 2, "90s");
  // What is given stays, also where it is what nobody's setting would begin as.
  std::ofstream(folder / "own.yaml") << "growth: 1.02\n";
  ubs_ok(folder,
         "train data --out own --dim 3 --budget 20s --cap-max 300000 --set lr_xyz=1.6e-4 --spec own.yaml");
  const std::string own = get(folder / "own/config.yaml");
  for (const char* part : {"\ncap_max: 300000", "\nlr_xyz: 0.00016", "\ngrowth: 1.02 "})
    CHECK_THAT(own, Contains(part));
  const Result hopeless = run_ubs(folder, "train --data data --out x --budget 0.001s");
  CHECK(hopeless.code == 2);
  CHECK_THAT(hopeless.err, Contains("increase the budget"));
  CHECK_FALSE(fs::exists(folder / "x/model.ply"));
  check_error(folder, "train --data data --out x --budget 9s --iterations 100", 2,
              "remove --budget or --iterations");
  check_error(folder, "train --resume run --budget 9s", 2, "--budget");
  check_error(folder, "train --data data --out x --pyramid 2:0.5,4:0.7", 2, "falling factors");
}

TEST_CASE("cli: evaluations by iterations, by seconds of training, and at the end") {
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
    while (std::getline(log, line)) count += line.find(",,") == std::string::npos;
    return count - 1;  // without the names of the columns
  };
  CHECK(evaluations("0") == 1);
  CHECK(evaluations("5") == 3);
  CHECK(evaluations("1e-9s") == 12);  // each iteration takes longer
  CHECK(evaluations("1000s") == 1);
}

}  // namespace
}  // namespace ubs
