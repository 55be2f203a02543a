// SPDX-License-Identifier: Apache-2.0
// Running experiments with a stand-in for `ubs train`: what is kept, repeated, reported, and how tables come
// out.
#include "host/experiment/runner.hpp"

#include <chrono>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "host/experiment/child_process.hpp"
#include "host/experiment/comparison.hpp"
#include "host/experiment/estimate.hpp"
#include "tests/experiment/made_up.hpp"

namespace ubs::experiment {
namespace {

namespace fs = std::filesystem;
using test::contains;
using test::get;
using test::message_of;
using test::put;
using test::TempFolder;

// "ubs train --data D --out O ...", or --resume O: notes its starts in O.. /starts, does what D/behaviour
// says. "ubs eval --model M --data D --out E ...": counts and fails likewise, if D/eval says so. "ubs plan
// --data D ...".
constexpr const char* kStandIn = R"(#!/bin/sh
if [ "$1" = eval ]; then
  echo "$*" >> "$(dirname "$0")/evals"
  lpips=; case "$*" in *lpips*) lpips=', "lpips_vgg_unit": 0.125' ;; esac
  if [ -n "$lpips" ] && [ -e "$5/small" ]; then echo "ubs: error: images too small" >&2; exit 3; fi
  if [ -e "$5/broken" ]; then echo "ubs: error: no device" >&2; exit 4; fi
  echo "{\"frames\": {\"fps_wall\": 250}, \"mean\": {\"psnr\": 1$lpips}}" > "$7"
  exit 0
fi
data=$3; out=$5
if [ "$1" = plan ]; then
  echo "ubs: this and that"
  case $(cat "$data/behaviour") in crash) kill -SEGV $$ ;; esac
  printf '{\n  "seconds": 7200,\n  "start": {\n    "splats": 5\n  }\n}\n'
  exit 0
fi
echo "$4 $data" >> "$(dirname "$0")/starts"
steps=$(sed -n 's/^iterations: \([0-9]*\).*/\1/p' "$out/job.yaml")
case $(cat "$data/behaviour") in
  stale) [ "$4" = --resume ] && { echo "ubs: error: $5/checkpoint.ubs: damaged checkpoint" >&2; exit 3; } ;;
  full) echo "ubs: error: log.csv: No space left on device; ubs train --resume $5" >&2; exit 3 ;;
  fail) echo "ubs: error: boom" >&2; exit 6 ;;
  crash) kill -SEGV $$ ;;
  wait) echo state > "$out/checkpoint.ubs"; trap 'exit 130' INT; while :; do sleep 0.05; done ;;
esac
rm -f "$out/checkpoint.ubs"
echo splats > "$out/model.ply"
cat > "$out/metrics.json" <<END
{"version": "9", "build": "b", "interrupted": false, "iterations": $steps, "seconds": 120, "splats": 900,
 "device": {"name": "paper", "platform": "desk"}, "settings": {"iterations": $steps},
 "test": {"iteration": $steps, "mean": {"psnr": $(cat "$data/psnr"), "ssim": 0.5}}}
END
)";

struct Desk {
  TempFolder folder;
  ExperimentSpec spec;
  RunOptions options;

  Desk() {
    put(folder / "set.yaml", kSet);
    put(folder / "e.yaml",
        "name: e\ntitle: An experiment\npublished: {source: a book, columns: [psnr, minutes]}\n"
        "data: [{set: set.yaml}]\nrows:\n  - name: a\n    label: Method A\n    published:\n"
        "      toys: {cube: [30.5, 1], sphere: [20, null], average: [25.25, null]}\n");
    put(folder / "ubs", kStandIn);
    fs::permissions(folder / "ubs", fs::perms::owner_all);
    scene("cube", "train", 31);
    scene("sphere", "train", 20.25);
    spec = load_experiment_spec(folder / "e.yaml");
    options = {.out = folder / "out",
               .executable = folder / "ubs",
               .resume = true,
               .environment = {{"commit", "c0ffee"}},
               .date = [] { return std::string("2026-11-20T00:00:00Z"); },
               .interrupted = [] { return false; }};
  }
  void scene(const std::string& name, const std::string& behaviour, double psnr) {
    put(folder / ("root/toys/" + name + "/behaviour"), behaviour);
    put(folder / ("root/toys/" + name + "/psnr"), fmt::format("{}", psnr));
  }
  std::vector<Job> plan(const std::string& iterations = "400") const {
    return make_plan(spec, {.root = folder / "root", .assignments = {{"iterations", iterations, "--set"}}},
                     [](const fs::path&, const TrainSettings&) { return 80; });
  }
  std::vector<JobResult> run(const std::string& iterations = "400") const {
    return run_jobs(plan(iterations), options);
  }
  long starts() const {
    const std::string text = get(folder / "starts");
    return std::count(text.begin(), text.end(), '\n');
  }
  std::vector<std::string> evals() const {
    std::vector<std::string> lines;
    std::istringstream stream(get(folder / "evals"));
    for (std::string line; std::getline(stream, line);) lines.push_back(line);
    return lines;
  }
  fs::path results(const std::string& scene) const { return folder / ("out/runs/a.toys." + scene); }
};

TEST_CASE("runner: complete runs of the same settings are kept, others repeated", "[experiment]") {
  Desk desk;
  std::vector<JobResult> results = desk.run();
  REQUIRE(results.size() == 2);
  INFO(results[0].reason);
  CHECK(results[0].state == JobState::done);
  CHECK(results[0].values.at("psnr") == 31);
  CHECK(results[0].values.at("fps") == 250);
  CHECK(results[0].values.at("minutes") == 2);
  CHECK(results[0].record["commit"] == "c0ffee");
  CHECK(results[0].record["identity"]["settings"]["iterations"] == 400);
  CHECK(desk.starts() == 2);
  CHECK(desk.evals().size() == 2);
  CHECK(fs::exists(desk.results("cube") / "job.json"));
  CHECK(test::file_count(desk.folder / "out/runs") == 2);  // nothing partial stays

  CHECK(desk.run()[1].values.at("psnr") == 20.25);
  CHECK(desk.starts() == 2);
  CHECK(desk.evals().size() == 2);
  CHECK(desk.run("401")[0].record["identity"]["settings"]["iterations"] == 401);
  CHECK(desk.starts() == 4);
  desk.options.resume = false;
  desk.run("401");
  CHECK(desk.starts() == 6);

  // The task of a job array is repeated with another build.
  desk.options.resume = desk.options.same_key = true;
  desk.options.key = [](const Job&) { return std::string("build 2"); };
  for (int i = 0; i < 2; ++i) desk.run("401");
  CHECK(desk.starts() == 8);
}

TEST_CASE("runner: what a killed program left is no result", "[experiment]") {
  Desk desk;
  desk.run();
  // Killed while the second job ran: its folder still has the partial name, however much is in it.
  fs::rename(desk.results("sphere"), fs::path(desk.results("sphere")).concat(".partial"));
  CHECK(desk.run()[1].state == JobState::done);
  CHECK(desk.starts() == 3);
  CHECK_FALSE(fs::exists(fs::path(desk.results("sphere")).concat(".partial")));
  fs::remove(desk.results("cube") / "job.json");
  desk.run();
  CHECK(desk.starts() == 4);
  put(desk.results("cube") / "metrics.json", get(desk.results("cube") / "metrics.json").substr(0, 50));
  desk.run();
  CHECK(desk.starts() == 5);
  std::string text = get(desk.results("cube") / "metrics.json");
  text.replace(text.find("\"interrupted\": false"), 20, "\"interrupted\": true");
  put(desk.results("cube") / "metrics.json", text);
  CHECK(contains(message_of([&] { read_metrics(desk.results("cube")); }), "interrupted"));
  desk.run();
  CHECK(desk.starts() == 6);
  text = get(desk.results("cube") / "metrics.json");
  text.replace(text.find("\"test\": {\"iteration\": 400"), 24, "\"test\": {\"iteration\": 300");
  put(desk.results("cube") / "metrics.json", text);
  CHECK(contains(message_of([&] { read_metrics(desk.results("cube")); }), "not that of the last iteration"));
}

TEST_CASE("runner: frames and LPIPS are measured of finished runs, also of earlier ones", "[experiment]") {
  Desk desk;
  desk.options.measure = {.fps_views = 7, .lpips_weights = {}, .why_no_lpips = "no weights"};
  std::vector<JobResult> results = desk.run();
  CHECK(results[0].values.at("fps") == 250);
  CHECK(results[0].lacks == std::map<std::string, std::string>{{"lpips", "no weights"}});
  REQUIRE(desk.evals().size() == 2);
  CHECK(contains(desk.evals()[0], "--fps-views 7"));
  CHECK_FALSE(contains(desk.evals()[0], "lpips"));
  Occasion occasion;
  std::string text =
      markdown(desk.spec, desk.plan(), results, compare(desk.spec, desk.plan(), results), occasion);
  CHECK(contains(text, "| FPS | paper |"));
  CHECK_FALSE(contains(text, "| LPIPS |"));  // neither we nor this table's paper have it

  // With weights the kept runs are measured again, not trained again.
  desk.options.measure.lpips_weights = "w.safetensors";
  desk.scene("sphere", "train", 20.25);
  put(desk.folder / "root/toys/sphere/small", "");
  results = desk.run();
  CHECK(desk.starts() == 2);
  CHECK(desk.evals().size() == 4);  // the frames of both are known
  CHECK(contains(desk.evals()[2], "--lpips vgg --lpips-range unit --lpips-weights w.safetensors"));
  CHECK(results[0].values.at("lpips") == 0.125);
  CHECK(results[0].lacks.empty());
  CHECK(results[1].values.at("fps") == 250);
  CHECK(results[1].lacks.at("lpips") == "images too small (exit code 3)");
  text = markdown(desk.spec, desk.plan(), results, compare(desk.spec, desk.plan(), results), occasion);
  CHECK(contains(text, "- LPIPS not measured of a/sphere: images too small (exit code 3)"));
  CHECK(
      contains(text, "| Method A | the sphere | 20.25 | 20.00 | +0.25 | 0.500 | – | – | – | – | – | 2.0 |"));

  // Where LPIPS cannot be had the frames are timed alone; where nothing can, the run stays.
  fs::remove(desk.results("sphere") / "eval.json");
  results = desk.run();
  CHECK(results[1].values.at("fps") == 250);
  CHECK_FALSE(contains(desk.evals().back(), "lpips"));
  fs::remove(desk.results("sphere") / "eval.json");
  put(desk.folder / "root/toys/sphere/broken", "");
  results = desk.run();
  CHECK(results[1].state == JobState::done);
  CHECK(results[1].lacks.at("fps") == "no device (exit code 4)");
  desk.options.measure.fps_views = 0;
  CHECK(contains(desk.run()[1].lacks.at("fps"), "--fps-views 0"));
}

TEST_CASE("runner: failing and missing runs are reported and the rest goes on", "[experiment]") {
  Desk desk;
  desk.scene("cube", "fail", 1);
  std::vector<JobResult> results = desk.run();
  CHECK(results[0].state == JobState::failed);
  CHECK(results[0].reason == "boom (exit code 6)");
  CHECK(results[0].code == 6);
  CHECK(results[1].state == JobState::done);
  desk.scene("cube", "crash", 1);
  results = desk.run();
  CHECK(contains(results[0].reason, "ended by signal 11"));
  CHECK(results[0].code == 1);
  fs::remove_all(desk.folder / "root/toys/cube");
  results = desk.run();
  CHECK(results[0].state == JobState::missing);
  CHECK(contains(results[0].reason, "toys/]cube"));
  CHECK(results[1].state == JobState::done);
}

TEST_CASE("runner: an interruption ends the running job in order and leaves the rest", "[experiment]") {
  // The next run goes on, starts anew where the checkpoint is refused, and leaves it after other errors.
  for (const std::string next : {"train", "stale", "full"}) {
    Desk desk;
    desk.scene("cube", "wait", 1);
    const auto start = std::chrono::steady_clock::now();
    // Some time after the child began, as by Ctrl-C to this process alone.
    desk.options.interrupted = [&] {
      return desk.starts() > 0 && std::chrono::steady_clock::now() - start > std::chrono::milliseconds(300);
    };
    const std::vector<JobResult> results = desk.run();
    CHECK(results[0].state == JobState::interrupted);
    CHECK(results[1].state == JobState::pending);
    CHECK_FALSE(fs::exists(desk.results("cube")));
    desk.options.interrupted = [] { return false; };
    desk.scene("cube", next, 31);
    CHECK(desk.run()[0].state == (next == "full" ? JobState::failed : JobState::done));
    CHECK(contains(get(desk.folder / "starts"), "--resume "));
    CHECK(desk.starts() == (next == "stale" ? 4 : 3));
    CHECK(fs::exists(fs::path(desk.results("cube")).concat(".partial/checkpoint.ubs")) == (next == "full"));
  }
}

TEST_CASE("tables: differences, means over the same scenes, and what is missing", "[experiment]") {
  Desk desk;
  const std::vector<Job> jobs = desk.plan();
  std::vector<JobResult> results = desk.run();
  Comparison comparison = compare(desk.spec, jobs, results);
  REQUIRE(comparison.lines.size() == 3);
  CHECK(*comparison.lines[0].cells.at("psnr").difference() == Approx(0.5));
  CHECK(*comparison.lines[0].cells.at("minutes").difference() == Approx(1));
  CHECK_FALSE(comparison.lines[1].cells.at("minutes").published);
  const Line& mean = comparison.lines[2];
  CHECK(mean.scene == kAverage);
  CHECK(*mean.cells.at("psnr").ours == Approx(25.625));
  CHECK(*mean.cells.at("psnr").published == Approx(25.25));
  CHECK(*mean.cells.at("minutes").ours == 2);  // over cube alone, which has both
  CHECK(*mean.cells.at("minutes").published == 1);
  CHECK(*mean.cells.at("ssim").ours == 0.5);
  CHECK_FALSE(mean.cells.at("ssim").published);

  const Occasion occasion{"2026-11-20T00:00:00Z", "9", "b", "c0ffee", "ubs experiment e.yaml", 4};
  std::string text = markdown(desk.spec, jobs, results, comparison, occasion);
  CHECK(
      contains(text, "| Method A | cube | 31.00 | 30.50 | +0.50 | 0.500 | – | – | 2.0 | 1.0 | 250.0 | – |"));
  CHECK(contains(text, "| Method A | mean of 2 of 2 | 25.62 | 25.25 | +0.38 |"));
  CHECK(contains(text, "| Method A | average as printed, 2 scenes | – | 25.25 | – |"));
  CHECK(contains(text, "paper (desk); ubs 9, build b, commit c0ffee"));
  CHECK(contains(text, "All runs have the published settings"));
  CHECK(contains(text, "scaled down by 4"));
  CHECK_FALSE(contains(text, "not measured of"));
  CHECK(contains(csv(comparison), "a,toys,cube,done,psnr,31,30.5,0.5\n"));
  CHECK(contains(csv(comparison), "a,toys,average,done,minutes,2,1,1\n"));

  // One scene fails: the mean of the other is not compared with the paper's mean over both.
  results[0] = {JobState::failed, "boom", {}, {}};
  comparison = compare(desk.spec, jobs, results);
  CHECK(*comparison.lines[2].cells.at("psnr").published == Approx(20));
  CHECK(*comparison.lines[2].cells.at("psnr").difference() == Approx(0.25));
  text = markdown(desk.spec, jobs, results, comparison, occasion);
  CHECK(contains(text, "mean of 1 of 2"));
  CHECK(contains(text, "| Method A | cube (failed) | – | 30.50 |"));
  CHECK(contains(text, "- a/toys/cube: failed: boom"));
  const Json json = to_json(desk.spec, jobs, results, comparison, occasion);
  CHECK(json["runs"][0]["state"] == "failed");
  CHECK(json["runs"][1]["ours"]["psnr"] == 20.25);
  CHECK(json["runs"][1]["settings"]["cap_max"] == 2000);
  CHECK(json["means"][0]["metrics"]["psnr"]["difference"] == Approx(0.25));
  CHECK(json["means"][0]["scenes_present"] == 1);

  const std::vector<Job> changed = desk.plan("200");
  text = markdown(desk.spec, changed, desk.run("200"), comparison, occasion);
  CHECK(contains(text, "a difference to the paper is expected"));
  CHECK(contains(text, "a/toys/cube, a/toys/sphere: iterations 400 -> 200"));
}

TEST_CASE("estimates: as ubs plan gives them, or why there is none", "[experiment]") {
  Desk desk;
  fs::create_directory(desk.folder / "work");
  const EstimateOptions options{.executable = desk.folder / "ubs",
                                .work = desk.folder / "work",
                                .device = {},
                                .interrupted = [] { return false; },
                                .say = {}};
  std::vector<Job> jobs = desk.plan();
  jobs.push_back(jobs[0]);
  desk.scene("sphere", "crash", 1);
  const std::vector<Estimate> estimates = estimate_hours(jobs, options);
  REQUIRE(estimates.size() == 3);
  CHECK(estimates[0].hours == 2.0);
  CHECK(estimates[0].plan["start"]["splats"] == 5);
  CHECK_FALSE(estimates[1].hours);
  CHECK(contains(estimates[1].problem, "ended by signal 11"));
  CHECK(contains(estimates[1].problem, "behind 'ubs: this and that'"));
  CHECK((estimates[0].own && !estimates[2].own && estimates[2].hours == 2.0));
}

}  // namespace
}  // namespace ubs::experiment
