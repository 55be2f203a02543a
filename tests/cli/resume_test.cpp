// SPDX-License-Identifier: Apache-2.0
// Tests runs that are killed or interrupted, and then resumed. The tracer of tests/fault kills them or sends
// a signal at a chosen system call, so the tests do not depend on the speed of the machine.
#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>
#include <string>

#include "host/base/text.hpp"
#include "host/dataset/blender.hpp"
#include "host/train/checkpoint.hpp"
#include "tests/fault/traced_run.hpp"
#include "tests/support/data.hpp"
#include "tests/support/lenient_kernels.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using nlohmann::json;
using test::check_error;
using test::Fault;
using test::get;
using test::put;
using test::put_scene;
using test::Result;
using test::run_ubs;
using test::TempFolder;
using test::TracedRun;
using test::ubs_ok;

constexpr const char* kRun =
    "--data data --init-points 300 --cap-max 350 --log-every 50 --save-renders 0 --quiet "
    "--iterations 1500";

void synthesise(const TempFolder& folder) { put_scene(folder / "data", 32, 8, 2); }

// Runs `ubs train` with these arguments and the output folder `out`. Applies the fault to system calls on the
// file `file` in this folder.
TracedRun faulty_run(const TempFolder& folder, const std::string& out, const std::string& arguments,
                     const std::string& file, const Fault& fault) {
  constexpr int kLimitSeconds = 600;  // only a run that hangs takes so long
  TracedRun run = test::trace_ubs(folder, fmt::format("train --out {} {}", shell_word(out), arguments),
                                  folder / out / file, fault, kLimitSeconds, fault.kinds);
  INFO(run.err);
  REQUIRE(run.struck);
  REQUIRE_FALSE(run.hung);
  return run;
}

// Kills the run after it has renamed the file of its second checkpoint to checkpoint.ubs.
void kill_run(const TempFolder& folder, const std::string& out, const std::string& arguments) {
  const Fault fault{.kinds = test::rename_calls, .nth = 2, .action = Fault::kill_after};
  REQUIRE(faulty_run(folder, out, arguments, "checkpoint.ubs", fault).signal == SIGKILL);
}

// Sends the signal to a run when it is about to write to its log for the third time.
void interrupt_run(const TempFolder& folder, const std::string& out, int signal, const std::string& more) {
  const Fault fault{.kinds = test::write_calls, .nth = 3, .action = Fault::signal, .number = signal};
  REQUIRE(faulty_run(folder, out, fmt::format("{} {}", kRun, more), "log.csv", fault).code == 130);
}

TEST_CASE("cli: a run that was killed or interrupted gives the same bytes when it is resumed") {
  const TempFolder folder;
  synthesise(folder);
  REQUIRE(run_ubs(folder, fmt::format("train {} --out whole", kRun)).code == 0);
  CHECK_FALSE(fs::exists(folder / "whole/checkpoint.ubs"));

  kill_run(folder, "killed", fmt::format("{} --checkpoint-every 100", kRun));
  CHECK_FALSE(fs::exists(folder / "killed/model.ply"));
  check_error(folder, fmt::format("train {} --out killed", kRun), 2, "--resume killed");
  const std::regex says("With 0, a\\s+checkpoint is\\s+only written if the run is\\s+interrupted");
  CHECK(std::regex_search(get(UBS_SOURCE_DIR "/docs/training.md"), says));
  interrupt_run(folder, "interrupted", SIGHUP, "--checkpoint-every 0");
  interrupt_run(folder, "terminated", SIGTERM, "");
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
    // A resumed run creates no initial splats.
    CHECK_THAT(metrics["data_report"].dump(), !Contains("random positions"));
  }
  check_error(folder, "train --resume whole", 2, "this run is finished");
}

// Tests Ctrl-C during training. `length` is the option for the length of the run, which must be longer than
// the test takes.
void check_ctrl_c(const std::string& length) {
  INFO(length);
  const TempFolder folder;
  synthesise(folder);
  const std::string train = "--data data --dim 3 --init-points 300 --cap-max 350 --log-every 1 " + length;
  const auto metrics = [&](const std::string& out) {
    return json::parse(get(folder / out / "metrics.json"));
  };
  Fault fault{.kinds = test::write_calls, .nth = 30, .action = Fault::signal, .number = SIGINT};
  TracedRun run = faulty_run(folder, "early", train, "log.csv", fault);
  INFO(run.err);
  CHECK(run.code == 130);
  CHECK_THAT(run.err, Contains("Ctrl-C: completing the schedule with a cool-down of about"));
  CHECK_THAT(run.out, Contains("finished early after") && Contains("\nrenders  "));
  const json early = metrics("early");
  CHECK(early["interrupted"] == false);
  CHECK(early["ended_early"]["iteration"].get<int>() >= 20);
  CHECK(early["ended_early"]["seconds"].get<double>() > 0);
  CHECK(early["iterations"] == early["settings"]["iterations"]);
  CHECK(early["test"]["iteration"] == early["iterations"]);
  CHECK_FALSE(fs::exists(folder / "early/checkpoint.ubs"));
  ubs_ok(folder, "train --data data --spec early/config.yaml --out again --quiet");
  bool same = get(folder / "early/model.ply") == get(folder / "again/model.ply");
  CHECK(same);

  // A run that was completed early is resumed at the iteration at which Ctrl-C was pressed. A run that
  // reached its regular end is resumed at its last iteration, and the last part of the schedule is run once
  // more.
  CHECK_THAT(run.out, Contains("longer   ubs train --resume early --budget +5m"));
  const int completed = early["ended_early"]["iteration"].get<int>();
  const Result on = ubs_ok(folder, "train --resume early --budget +1s");
  CHECK_THAT(on.out, Contains(fmt::format("resumed  at iteration {},", completed)));
  const json whole = metrics("early");
  CHECK(whole["ended_early"].is_null());
  check_error(folder, "train --resume early", 2, "early: this run is finished: to continue it, pass");
  const Result longer = ubs_ok(folder, "train --resume early --budget +1s");
  const json last = metrics("early");
  CHECK_THAT(longer.out, Contains(fmt::format("resumed  at iteration {},", whole["iterations"].get<int>())));
  CHECK(last["iterations"].get<int>() > whole["iterations"].get<int>());
  CHECK(last["seconds"].get<double>() > whole["seconds"].get<double>());
  CHECK(last["test"]["iteration"] == last["iterations"]);
  CHECK_FALSE(fs::exists(folder / "early/checkpoint.ubs"));
  ubs_ok(folder, "train --data data --spec early/config.yaml --out longer --quiet");
  same = get(folder / "early/model.ply") == get(folder / "longer/model.ply");
  CHECK(same);

  // The signal is sent at every write to the log from the 30th on. Signals within half a second after the
  // first one count as the same Ctrl-C, and a later signal counts as the second Ctrl-C.
  fault.lasting = true;
  run = faulty_run(folder, "ended", train, "log.csv", fault);
  INFO(run.err);
  CHECK(run.code == 130);
  const json ended = metrics("ended");
  CHECK(ended["interrupted"] == true);
  const int before = ended["ended_early"]["iteration"].get<int>();
  CHECK(ended["iterations"].get<int>() > before);
  CHECK_THAT(run.out, Contains(fmt::format("continues after iteration {}, as if", before)));
  CHECK(read_checkpoint(folder / "ended/checkpoint.ubs").state.iteration == before);
  CHECK_THAT(ubs_ok(folder, "train --resume ended --budget +1s").out,
             Contains(fmt::format("resumed  at iteration {},", before)) && Contains("finished after"));

  fault.lasting = false;
  fault.number = SIGTERM;
  CHECK(faulty_run(folder, "terminated", train, "log.csv", fault).code == 130);
  CHECK(metrics("terminated")["interrupted"] == true);
  CHECK(metrics("terminated")["ended_early"].is_null());
}

TEST_CASE("cli: the first Ctrl-C completes a run, and the second one ends it") {
  check_ctrl_c("--budget 1h");
  check_ctrl_c("--iterations 200000");
}

TEST_CASE("cli: a run that Ctrl-C has completed early can be resumed as if Ctrl-C had not been pressed") {
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} --out whole", kRun));
  const Fault fault{.kinds = test::write_calls, .nth = 3, .action = Fault::signal, .number = SIGINT};
  REQUIRE(faulty_run(folder, "early", kRun, "log.csv", fault).code == 130);
  CHECK(get(folder / "early/model.ply") != get(folder / "whole/model.ply"));
  ubs_ok(folder, "train --resume early --quiet");
  CHECK(get(folder / "early/model.ply") == get(folder / "whole/model.ply"));
  CHECK(get(folder / "early/config.yaml") == get(folder / "whole/config.yaml"));
}

TEST_CASE("cli: a checkpoint is not resumed in the folder of another run") {
  const TempFolder folder;
  synthesise(folder);
  interrupt_run(folder, "a", SIGTERM, "--checkpoint-every 60");
  interrupt_run(folder, "other", SIGTERM, "--checkpoint-every 60 --seed 5");
  // Runs with the same settings and data are distinguished by the seconds in the first row of the log.
  Checkpoint same = read_checkpoint(folder / "a/checkpoint.ubs");
  same.first_row.insert(same.first_row.find(',') + 1, "9");
  fs::create_directory(folder / "same");
  write_checkpoint(folder / "same/checkpoint.ubs", same);
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
              "another run than config.yaml in the same folder (cannot resume with seed = 5");
  put(folder / "a/checkpoint.ubs", own);
  CHECK(run_ubs(folder, "train --resume a --quiet").code == 0);
  // A folder that only contains a checkpoint is sufficient to resume a run.
  fs::create_directories(folder / "new");
  fs::copy_file(folder / "other/checkpoint.ubs", folder / "new/checkpoint.ubs");
  CHECK(run_ubs(folder, "train --resume new --quiet").code == 0);
}

// Names of folders are arbitrary bytes. The name in this test is encoded in Latin-1, and contains a line
// break and an escape sequence of encode_text().
TEST_CASE("cli: a run on a data path that is not valid text is resumed") {
  const TempFolder folder;
  const std::string name = "caf\xe9 \\x41\n'q'", run = name + " run";
  put_scene(folder / name, 24, 6, 2);
  kill_run(
      folder, run,
      fmt::format("--data {} --dim 3 --iterations 60 --init-points 100 --cap-max 120 --checkpoint-every 20",
                  shell_word((folder / name).string())));
  REQUIRE_FALSE(fs::exists(folder / run / "model.ply"));
  ubs_ok(folder, fmt::format("train --resume {}", shell_word(run)));
  CHECK(decode_text(json::parse(get(folder / run / "metrics.json"))["data"].get<std::string>()) ==
        (folder / name).string());
}

TEST_CASE("cli: a run that cannot be resumed is reported in one line") {
  const TempFolder folder;
  synthesise(folder);
  interrupt_run(folder, "run", SIGTERM, "--refine-cameras pose");
  CHECK(json::parse(get(folder / "run/cameras/transforms.json"))["frames"].size() == 8);
  check_error(folder, "train --resume nowhere", 3, "no checkpoint.ubs");
  check_error(folder, "train --resume run --out other", 2, "remove --out");
  check_error(folder, "train --resume run --lr-rgb 0.5", 2,
              "cannot resume with lr_rgb = 0.5: the run was started with lr_rgb = 0.005");
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
  fs::remove(folder / "run/checkpoint.ubs");
  check_error(folder, "train --resume run", 3, "was interrupted, but its checkpoint.ubs is missing");
  put(folder / "killed/checkpoint.ubs", bytes);
  check_error(folder, "info killed", 3,
              "the run is not finished: continue it with 'ubs train --resume killed'");
  put(folder / "run/checkpoint.ubs", bytes);
  CHECK(run_ubs(folder, "train --resume run --quiet --save-renders 1").code == 0);
}

#ifdef UBS_SCARCE_MEMORY
// In this test, the memory for an image that is read during training cannot be allocated.
TEST_CASE("cli: a run that exhausts the memory keeps its state, and gives the same bytes if resumed") {
  const TempFolder folder;
  constexpr int kSide = 201;  // ten images of 121 203 bytes do not fit into the cache
  put_scene(folder / "data", kSide, 8, 2);
  const std::string run =
      "--data data --init-points 100 --cap-max 120 --dim 3 --schedule published --iterations 100 "
      "--image-cache-mb 1 "
      "--checkpoint-every 0 --save-renders 0 --quiet";
  ubs_ok(folder, fmt::format("train {} --out whole", run));
  const Result result =
      test::run_command(folder, fmt::format("UBS_SCARCE_MEMORY={},45 LD_PRELOAD={} '{}' train {} --out run",
                                            3 * kSide * kSide, UBS_SCARCE_MEMORY, UBS_EXECUTABLE, run));
  INFO(result.err);
  REQUIRE(result.code == 6);
  CHECK_THAT(result.err, Contains("ubs: error: out of memory") &&
                             Contains("was saved: resume with 'ubs train --resume run'"));
  CHECK_FALSE(fs::exists(folder / "run/model.ply"));
  const int iteration = read_checkpoint(folder / "run/checkpoint.ubs").state.iteration;
  CHECK((iteration > 0 && iteration < 100));
  ubs_ok(folder, "train --resume run --quiet");
  CHECK(get(folder / "run/model.ply") == get(folder / "whole/model.ply"));
}

TEST_CASE("cli: a run continues if there is no memory for the copy of its state that a checkpoint needs") {
  const TempFolder folder;
  synthesise(folder);
  constexpr int kSplats = 120;
  const std::string run =
      "train --data data --init-points 120 --cap-max 120 --dim 3 --iterations 30 --checkpoint-every 10 "
      "--save-renders 0 --quiet --out ";
  ubs_ok(folder, run + "whole");
  const std::size_t rows = read_checkpoint(folder / "whole/continue.ubs").state.model.values.size() / kSplats;
  // Each of the first allocations of this size fails in turn, until one of them is that of a checkpoint.
  bool seen = false;
  for (int nth = 1; nth <= 30 && !seen; ++nth) {
    const Result result = test::run_command(
        folder, fmt::format("UBS_SCARCE_MEMORY={},{} LD_PRELOAD={} '{}' {}run --overwrite",
                            rows * kSplats * sizeof(float), nth, UBS_SCARCE_MEMORY, UBS_EXECUTABLE, run));
    seen = result.code == 0 && test::contains(result.err, "out of memory");
    if (!seen) continue;
    INFO(result.err);
    CHECK(get(folder / "run/model.ply") == get(folder / "whole/model.ply"));
  }
  CHECK(seen);
}
#endif

// Changes splat 7 of a checkpoint to finite parameters whose gradient is not finite. They describe a large
// splat half way to the first camera, with colours of 1e38. SSIM squares these colours, which overflows.
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

TEST_CASE("cli: a value that is not finite gives exit code 7, and the message contains iteration and stage") {
  const test::LenientKernels kernels;
  const TempFolder folder;
  synthesise(folder);
  interrupt_run(folder, "run", SIGTERM, "");
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
  // Without this splat the run is completed, unless other splats have also become unusable.
  const Result dropped = run_ubs(folder, "train --resume run --quiet --on-nan drop");
  INFO(dropped.err);
  const bool refused = test::contains(dropped.err, "would have been dropped");
  CHECK(dropped.code == (refused ? 7 : 0));
  CHECK(fs::exists(folder / "run/checkpoint.ubs") == refused);
}

}  // namespace
}  // namespace ubs
