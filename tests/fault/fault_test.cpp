// SPDX-License-Identifier: Apache-2.0
// Tests the files that remain if the disk is full or broken while a command runs, or if the command is killed
// or interrupted (campaign.hpp). Such a fault is introduced at a system call on the results or the inputs of
// the command. By default, a sample of these calls is tested. With UBS_TEST_ALL=1, all of them are tested.
// test_fault "[long]" tests further commands and file systems, which takes minutes.
#include <algorithm>
#include <csignal>
#include <fstream>
#include <nlohmann/json.hpp>
#include <vector>

#include "tests/fault/campaign.hpp"
#include "tests/support/made_scene.hpp"

namespace ubs::test {
namespace {

namespace fs = std::filesystem;

void synthesise(const TempFolder& folder) { put_scene(folder / "data", 32, 5, 2); }

constexpr const char* kTraining =
    "--data data --dim 3 --init-points 150 --cap-max 150 --iterations 30 --checkpoint-every 10 "
    "--log-every 10 --quiet --out ";

// Returns a string that is the same for the complete files of all runs, although the files contain different
// times. For incomplete pages, JSON files and logs, the text is different.
std::string without_times(const std::string& path, const std::string& bytes) {
  if (path.ends_with(".html")) return bytes.find("</html>") != std::string::npos ? "a page" : "broken";
  if (path.ends_with(".md")) return "a text";
  if (path.ends_with(".json")) return nlohmann::json::accept(bytes) ? "a JSON file" : "broken: " + bytes;
  if (path.ends_with("log.csv")) return without_seconds(bytes);
  if (path == "continue.ubs") return "a state";
  return bytes;
}

std::vector<FaultKind> both(std::vector<FaultKind> faults, const std::vector<FaultKind>& more) {
  faults.insert(faults.end(), more.begin(), more.end());
  return faults;
}

// After a fault, the pack command must leave the complete file or no file. A page in docs/results uses the
// name of this test.
TEST_CASE("faults: pack") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  Scenario scenario{.command = "pack data --out out/F.ubsd --overwrite"};
  attack(folder, "pack, disk and killed", scenario, both(writing_faults(), kills()), 2);
  attack(folder, "pack, signalled", scenario, signals(), 1);
  scenario.watched = "data";
  attack(folder, "pack, reading", scenario, reading_faults(), 2);
}

TEST_CASE("faults: convert leaves the old file or the complete new file") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} run", kTraining));
  ubs_ok(folder, fmt::format("train {} run2 --seed 5", kTraining));
  const Scenario scenario{.command = "convert run/model.ply out/m.spz --distill 0 --no-measure --overwrite",
                          .before = "convert run2/model.ply out/m.spz --distill 0 --no-measure"};
  attack(folder, "convert, disk and killed", scenario, both(writing_faults(), kills()), 2);
  attack(
      folder, "convert, reading",
      {.command = "convert run/model.ply out/m.splat --distill 0 --no-measure --overwrite", .watched = "run"},
      reading_faults(), 1);
}

Scenario training() {
  return {.command = fmt::format("train {} out --overwrite", kTraining),
          .before = fmt::format("train {} out --seed 5", kTraining),
          .keeps_at_signal = true,
          .best_effort = true,
          .complete =
              [](const TempFolder& f) {
                return fs::exists(f / "out/checkpoint.ubs")
                           ? std::string("train --resume out --quiet")
                           : fmt::format("train {} out --overwrite", kTraining);
              },
          .common = without_times};
}

TEST_CASE("faults: train can be completed, and a signal while it changes files ends it in a controlled way") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  Scenario scenario = training();
  attack(folder, "train, disk", scenario, writing_faults(), 1);
  attack(folder, "train, killed and signalled", scenario, both(kills(), signals()), 2);
  scenario.watched = "data";
  attack(folder, "train, reading", scenario, reading_faults(), 1);
}

TEST_CASE("faults: render leaves only complete images, and can be repeated") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} run", kTraining));
  const Scenario scenario{.command = "render run/model.ply --data data --out out --format npy --overwrite"};
  attack(folder, "render, disk and killed", scenario, both(writing_faults(), kills()), 1);
}

// These commands take longer, or use the same code as the commands above.
TEST_CASE("faults: other commands leave only complete files, and can be repeated", "[.long]") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} run", kTraining));
  const Scenario scenarios[] = {
      {.command = "gradients --model run/model.ply --data data --view 1 --out out/g.ply --overwrite"},
      {.command =
           "synth glossy --out out/s --size 16 --views 2 --test-views 1 --supersampling 1 --overwrite"},
      {.command = "eval --model run/model.ply --data data --fps-views 0 --out out/e.json --overwrite",
       .common = without_times},
      {.command =
           "reduce --model run/model.ply --data data --bound 0.01 --out out/r.ply --quiet --overwrite"},
      {.command =
           "render run/model.ply --path orbit --path-frames 3 --size 64x64 --video out/v.avi --overwrite"},
      {.command = "report run --out out/r.html --views 1 --overwrite", .common = without_times},
      {.command = "bench --quick --run ^sum.*glossy --sizes 64x64/100 --json out/bench.json --overwrite",
       .common = without_times},
  };
  for (const Scenario& scenario : scenarios) {
    const std::string name = scenario.command.substr(0, scenario.command.find(' '));
    attack(folder, name + ", disk", scenario, writing_faults(), 4);
    attack(folder, name + ", killed", scenario, kills(), 4);
    attack(folder, name + ", signalled", scenario, signals(), 2);
  }
}

TEST_CASE("faults: tune and accuracy leave only complete files, and can be repeated", "[.long]") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} run", kTraining));
  const auto present = [](const std::string& path, const std::string& bytes) {
    return path.ends_with(".json") ? without_times(path, bytes) : std::string("present");
  };
  const Scenario tune{.command = "tune --quick --max-time 1 --json out/t.json --overwrite",
                      .environment = "UBS_TUNING_DIR=out/tuning",
                      .common = present};
  attack(folder, "tune, disk", tune, writing_faults(), 2);
  attack(folder, "tune, killed", tune, kills(), 2);
  attack(folder, "accuracy, disk",
         {.command = "accuracy --quick --quiet --out out/a --overwrite", .common = present}, writing_faults(),
         1);
}

TEST_CASE("faults: after a fault in writing the cache of compiled kernels, the command can be repeated",
          "[.long]") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} run", kTraining));
  const Scenario kernels{.command = "render run/model.ply --data data --views 0 --out out --overwrite",
                         .watched = "cache",
                         .environment = fmt::format("UBS_KERNEL_CACHE='{}'", (folder / "cache").string()),
                         .emptied = "cache",
                         .codes = {0, 3, 4},
                         .has_children = true,  // PoCL starts a linker
                         .best_effort = true};
  attack(folder, "kernel cache, disk", kernels, writing_faults(), 2);
  attack(folder, "kernel cache, killed", kernels, kills(), 3);
}

TEST_CASE("Ctrl-C before the first iteration prints one line and leaves no files that prevent a new run") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  const TracedRun run = trace_ubs(folder, "train data --budget 1h --out run", folder / "data",
                                  Fault{look_calls, 1, Fault::signal, SIGINT});
  CHECK(run.struck);
  CHECK(run.code == 130);
  CHECK(run.err == "\nubs: interrupted before the first iteration; nothing was written\n");
  ubs_ok(folder, "train data --iterations 1 --init-points 10 --cap-max 10 --out run");
  CHECK(fs::exists(folder / "run/model.ply"));
}

TEST_CASE("eval, render and reduce open the file with the test cameras only once") {
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} run", kTraining));
  fs::rename(folder / "data", folder / "moved");
  for (const char* arguments :
       {"eval run moved", "render run moved --out out", "reduce run moved --out r.ply"}) {
    const TracedRun run = trace_ubs(folder, arguments, folder / "moved");
    INFO(arguments << "\n" << run.err);
    CHECK(run.code == 0);
    CHECK(std::ranges::count_if(run.calls, [](const Call& call) {
            return call.kind == look_calls && call.path == "transforms_test.json";
          }) == 1);
  }
}

TEST_CASE(
    "exceeding the memory limit of a control group gives exit code 6, before the kernel kills the process") {
  const TempFolder folder;
  synthesise(folder);
  const fs::path group = fmt::format("/sys/fs/cgroup/memory/ubs-test-{}", ::getpid());
  std::error_code refused;
  fs::create_directory(group, refused);
  if (!fs::exists(group / "memory.limit_in_bytes")) {
    fs::remove(group, refused);
    WARN("control groups of version 1 cannot be created here: their limits are not tested");
    return;
  }
  std::ofstream(group / "memory.limit_in_bytes") << "400M";
  const Result result = run_command(
      folder, fmt::format("sh -c 'echo $$ >{}/cgroup.procs; exec \"{}\" train --data data --out run --quiet "
                          "--init-points 3000 --cap-max 1000000 --iterations 3000'",
                          group.string(), UBS_EXECUTABLE));
  fs::remove(group);
  INFO(result.err);
  CHECK(result.code == 6);
  CHECK(error_lines(result.err) == 1);
}

TEST_CASE("power cuts: reported results remain, and unfinished work can be completed") {
  if (!LoopDisk::possible()) {
    WARN("loop devices cannot be mounted here: for power cuts, only the order of system calls is tested");
    return;
  }
  REQUIRE(can_trace());
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} run", kTraining));
  LoopDisk disk(folder / "out", "mkfs.ext4 -q -m 0");
  attack(folder, "pack, power cut", {.command = "pack data --out out/F.ubsd --overwrite", .disk = &disk},
         power_cuts(), 1);
  attack(folder, "convert, power cut",
         {.command = "convert run/model.ply out/m.spz --distill 0 --no-measure", .disk = &disk}, power_cuts(),
         1);
  Scenario scenario = training();
  scenario.disk = &disk;
  attack(folder, "train, power cut", scenario, power_cuts(), 2);
}

TEST_CASE("killed commands can be completed on exFAT, Btrfs, XFS and NTFS", "[.long]") {
  REQUIRE(LoopDisk::possible());
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, fmt::format("train {} run", kTraining));
  struct Kind {
    const char *make, *mount;
    int mebibytes;
  };
  for (const Kind& kind : {Kind{"mkfs.exfat", "mount.exfat-fuse", 32}, Kind{"mkfs.btrfs -q", "mount", 128},
                           Kind{"mkfs.xfs -q", "mount", 320}, Kind{"mkfs.ntfs -q -F", "mount.ntfs-3g", 32}}) {
    LoopDisk disk(folder / "out", kind.make, kind.mebibytes, kind.mount);
    Scenario scenario = training();
    scenario.disk = &disk;
    attack(folder, fmt::format("train, {}, killed", kind.make), scenario, kills(), 2);
    attack(folder, fmt::format("pack, {}, killed", kind.make),
           {.command = "pack data --out out/F.ubsd --overwrite", .disk = &disk}, kills(), 2);
  }
}

}  // namespace
}  // namespace ubs::test
