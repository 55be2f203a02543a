// SPDX-License-Identifier: Apache-2.0
// Tests that power cuts, kills and full disks destroy no results. For power cuts, the tests check the order
// of the system calls of commands that write files. They assume that data are on the disk after the file has
// been synchronised, and that a name is on the disk after its folder has been synchronised.
#include <algorithm>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/fault/traced_run.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kRun =
    "--data data --init-points 100 --cap-max 120 --iterations 20 --log-every 5 --checkpoint-every 8 --quiet";

bool is_any(const std::string& name, std::initializer_list<const char*> names) {
  return std::ranges::count(names, name) > 0;
}

std::string folder_of(const std::string& path) {
  const fs::path folder = fs::path(path).parent_path();
  return folder.empty() ? "." : folder.string();
}

// Returns a description of an error in the order of the calls, or an empty string if the order is correct. It
// is correct if every name in the folder belongs to a complete file at any time, if all results are on the
// disk at the end, and if the file `last` is removed or renamed after all results are on the disk. Log files
// grow line by line, so they may be incomplete before the end.
std::string defect(const TracedRun& run, const std::string& last = "") {
  // `unsynced` contains files that were written to and not synchronised since. `fresh` contains folders that
  // got new names and were not synchronised since.
  std::set<std::string> unsynced, fresh;
  int renames = 0;
  for (const Call& call : run.calls) {
    if (call.result < 0) continue;
    const fs::path path = call.path;
    const std::string name = path.filename().string();
    if (is_any(name, {".ubs-lock", "stdout.txt", "stderr.txt"})) continue;  // not needed after a power cut
    const bool removes = call.kind == remove_calls || call.kind == rename_calls;
    if (removes && call.path == last && (!unsynced.empty() || !fresh.empty()))
      return fmt::format("{} was removed before {} was on the disk", last,
                         fmt::join(unsynced.empty() ? fresh : unsynced, ", "));
    const bool temporary = name.starts_with(".ubs-tmp-"), grows = name.ends_with(".log") || name == "log.csv";
    if (call.kind == write_calls) {
      if (!temporary && !grows) return fmt::format("{} is written in place", call.path);
      unsynced.insert(call.path);
    } else if (call.kind == sync_calls) {
      unsynced.erase(call.path);
      fresh.erase(call.path == "" ? "." : call.path);
    } else if (call.kind == rename_calls) {
      ++renames;
      if (unsynced.contains(call.path))
        return fmt::format("{} was not on the disk when it was renamed to {}", call.path, call.to);
      fresh.insert(folder_of(call.to));
    } else if (call.kind == make_calls) {
      fresh.insert(folder_of(call.path));
    }
  }
  if (renames == 0) return "nothing was written";
  if (!unsynced.empty()) return fmt::format("{} is not on the disk at the end", *unsynced.begin());
  if (!fresh.empty()) return fmt::format("names in {} are not on the disk at the end", *fresh.begin());
  return "";
}

void prepare(const TempFolder& folder) { put_scene(folder / "data", 32, 4, 2); }

TEST_CASE("durability: commands synchronise each file before they rename it, and its folder afterwards") {
  REQUIRE(can_trace());
  const TempFolder folder;
  prepare(folder);
  ubs_ok(folder, fmt::format("train --out run {}", kRun));
  ubs_ok(folder, "convert run/model.ply m.3dgs.ply --to 3dgs --distill 0");
  const char* commands[] = {
      "synth orbit --out o/data --size 32 --views 2 --test-views 1 --supersampling 1",
      "pack data --out o/F.ubsd",
      "eval --model run/model.ply --data data --fps-views 0 --out o/e.json",
      "metrics data/test/r_000.png data/test/r_001.png --out o/m.json",
      "render run/model.ply --data data --channels rgb,alpha,depth --out o/png",
      "render run/model.ply --data data --channels rgb,depth --format npy --out o/npy",
      "render run/model.ply --data data --video o/v.avi",
      "convert run/model.ply o/c.ply --to ubs",
      "convert run/model.ply o/g.ply --to 3dgs --distill 0",
      "convert run/model.ply o/c.spz --distill 0",
      "convert run/model.ply o/c.splat --distill 0",
      "convert run/model.ply o/c.usda --distill 0",
      "convert m.3dgs.ply o/i.ply",
      "gradients --model run/model.ply --data data --view 0 --out o/d.ply",
      "reduce --model run/model.ply --data data --bound 0.1 --quiet --out o/r.ply --effects o/r.csv",
      "report run --out o/r.html",
      "bench --quick --run '^adam.random' --json o/b.json",
      "accuracy --quick --out o/accuracy",
      "compare --devices cpu --model run/model.ply --data data --repeat 1 --out o/compare",
      "tune --quick --raster cpu --size 48x40/500 --max-time 0.1 --json o/t.json",
  };
  fs::create_directory(folder / "o");
  for (const char* command : commands) {
    const TracedRun run = trace_command(
        folder, fmt::format("env UBS_TUNING_DIR=o/tuning '{}' {}", program_of(command), command),
        folder / "o");
    INFO(command << "\n" << run.err << "\n" << to_text(run.calls));
    CHECK(run.code == 0);
    CHECK(defect(run) == "");
  }
}

TEST_CASE("durability: the checkpoint is renamed to continue.ubs after all other results are on the disk") {
  REQUIRE(can_trace());
  const TempFolder folder;
  prepare(folder);
  const TracedRun run = trace_ubs(folder, fmt::format("train --out run {}", kRun), folder / "run");
  INFO(run.err << "\n" << to_text(run.calls));
  REQUIRE(run.code == 0);
  CHECK(defect(run, "checkpoint.ubs") == "");
  const auto kept = std::ranges::find_if(run.calls, [](const Call& call) {
    return call.kind == rename_calls && call.path == "checkpoint.ubs" && call.result == 0;
  });
  REQUIRE(kept != run.calls.end());
  CHECK(kept->to == "continue.ubs");
  for (const char* name :
       {"model.ply", "metrics.json", "config.yaml", "renders/r_000.png", "renders/r_001.png"})
    CHECK(std::find_if(run.calls.begin(), kept, [&](const Call& call) {
            return call.kind == rename_calls && call.to == name;
          }) != kept);
  CHECK(std::none_of(kept + 1, run.calls.end(), [](const Call& call) { return call.kind == rename_calls; }));
}

// Checks that the run is complete and equal to `whole`, and that no temporary file remains.
void check_same_run(const fs::path& run, const fs::path& whole) {
  for (const char* name : {"model.ply", "renders/r_000.png", "renders/r_001.png"})
    CHECK(get(run / name) == get(whole / name));
  CHECK(without_seconds(get(run / "log.csv")) == without_seconds(get(whole / "log.csv")));
  const json a = json::parse(get(run / "metrics.json")), b = json::parse(get(whole / "metrics.json"));
  CHECK(a["interrupted"] == false);
  CHECK(a["test"]["mean"] == b["test"]["mean"]);
  CHECK_FALSE(fs::exists(run / "checkpoint.ubs"));
  for (const auto& entry : fs::recursive_directory_iterator(run))
    CHECK_FALSE(entry.path().filename().string().starts_with(".ubs-tmp-"));
}

TEST_CASE("durability: a run that is killed at any rename or removal can be completed") {
  REQUIRE(can_trace());
  const TempFolder folder;
  prepare(folder);
  const std::string start = fmt::format("train --out run {} --overwrite", kRun);
  const TracedRun whole = trace_ubs(folder, start, folder / "run");
  REQUIRE(whole.code == 0);
  fs::rename(folder / "run", folder / "whole");
  int resumed = 0;
  const unsigned kinds = rename_calls | remove_calls;
  const int calls = whole.count(kinds);
  for (int n = 1; n <= calls; ++n) {
    // By default, tests half of the calls, and all of the last eight calls, which write the results. The
    // process is killed alternately before and after the call.
    if (!whole_sweep() && n % 4 > 1 && n + 8 <= calls) continue;
    INFO("call " << n << " of " << whole.count(kinds));
    fs::remove_all(folder / "run");
    const TracedRun run = trace_ubs(folder, start, folder / "run",
                                    Fault{kinds, n, n % 2 ? Fault::kill_before : Fault::kill_after});
    CHECK(run.signal == SIGKILL);
    const bool kept = fs::exists(folder / "run/checkpoint.ubs");
    resumed += kept;
    // If the checkpoint has already been renamed to continue.ubs, the run is complete. If there is no
    // checkpoint yet, the run is started again.
    const bool done = !kept && fs::exists(folder / "run/metrics.json");
    if (!done) ubs_ok(folder, kept ? "train --resume run --quiet" : start);
    check_same_run(folder / "run", folder / "whole");
  }
  // The checkpoint still exists when the model, the metrics and the two renders are renamed, so at least the
  // runs that are killed at these four calls must have been resumed.
  CHECK(resumed >= 4);
}

// Returns the number of the first call for which `wanted` returns true, or 0 if there is none. Only calls of
// these kinds are counted, starting with 1.
int number_of(const TracedRun& run, unsigned kinds, const std::function<bool(const Call&)>& wanted) {
  int n = 0;
  for (const Call& call : run.calls) {
    if ((call.kind & kinds) == 0) continue;
    ++n;
    if (wanted(call)) return n;
  }
  return 0;
}

TEST_CASE(
    "durability: a run continues after one failed write; if the disk stays full, it stops and can be "
    "resumed") {
  REQUIRE(can_trace());
  const TempFolder folder;
  prepare(folder);
  const std::string start = fmt::format("train --out run {} --overwrite", kRun);
  const TracedRun clean = trace_ubs(folder, start, folder / "run");
  REQUIRE(clean.code == 0);
  fs::rename(folder / "run", folder / "whole");
  const int log_row = number_of(clean, write_calls, [](const Call& call) { return call.path == "log.csv"; });
  const int render = number_of(clean, write_calls,
                               [](const Call& call) { return call.path.starts_with("renders/.ubs-tmp-"); });
  REQUIRE(log_row > 0);
  REQUIRE(render > log_row);
  for (const auto& [nth, warns] : {std::pair{log_row, true}, {render, false}})
    for (const Fault::Action action : {Fault::fail, Fault::shorten}) {
      INFO("write " << nth << (action == Fault::fail ? " fails" : " is cut short"));
      fs::remove_all(folder / "run");
      const TracedRun run = trace_ubs(folder, start, folder / "run", Fault{write_calls, nth, action, ENOSPC});
      INFO(run.err);
      CHECK(run.struck);
      CHECK(run.code == 0);
      const auto warnings = std::count(run.err.begin(), run.err.end(), '\n');
      CHECK(warnings == (warns && action == Fault::fail ? 1 : 0));
      if (warnings > 0) CHECK(run.err.find("log.csv: writing failed") != std::string::npos);
      check_same_run(folder / "run", folder / "whole");
    }
  // If the disk stays full, ubs prints one error line, and the run can be resumed when there is space again.
  const int behind = number_of(clean, write_calls, [&, seen = 0](const Call& call) mutable {
    return call.path == "log.csv" && ++seen == 3;
  });
  fs::remove_all(folder / "run");
  const TracedRun full =
      trace_ubs(folder, start, folder / "run", Fault{write_calls, behind, Fault::fail, ENOSPC, true});
  INFO(full.err);
  CHECK(full.code == 3);
  CHECK(full.err.find("ubs: error: ") != std::string::npos);
  REQUIRE(fs::exists(folder / "run/checkpoint.ubs"));
  ubs_ok(folder, "train --resume run --quiet");
  check_same_run(folder / "run", folder / "whole");
}

}  // namespace
}  // namespace ubs::test
