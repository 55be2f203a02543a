// SPDX-License-Identifier: Apache-2.0
// ubs experiment: trains the runs of an experiment for which data are there and sets the results beside the
// published ones (docs/experiments.md).
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <memory>
#include <optional>

#include "host/base/environment.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/experiment/child_process.hpp"
#include "host/experiment/comparison.hpp"
#include "host/experiment/estimate.hpp"
#include "host/experiment/runner.hpp"
#include "host/metrics/image_metrics.hpp"
#include "host/run/open_data.hpp"
#include "tools/commands.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/job.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/settings_options.hpp"
#include "tools/common/version.hpp"
#include "tools/help.hpp"

namespace ubs::tools {
namespace {

using namespace ubs::experiment;
namespace fs = std::filesystem;

constexpr double kLockPatience = 10;  // seconds; a killed run's training process has to save and go
constexpr int kScaleDown = 4;

struct ExperimentOptions {
  std::string spec, root, out, device, lpips_weights;
  std::vector<std::string> scenes, rows, scene_folders, assignments, train_arguments;
  int scale_down = 1, fps_views = experiment::MeasureOptions().fps_views;
  std::string task;
  bool emit_tasks = false, dry_run = false, resume = false, overwrite = false, quiet = false, json = false;
};

PlanOptions plan_options(const ExperimentOptions& options) {
  PlanOptions plan{options.root, options.scenes, options.rows, {}, options.scale_down, {}};
  for (const std::string& text : options.scene_folders) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
      fail(ErrorKind::usage, "--scene-folder: '{}' is not of the form SCENE=FOLDER", text);
    plan.scene_folders[text.substr(0, equals)] = text.substr(equals + 1);
  }
  for (const std::string& text : options.assignments) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos) fail(ErrorKind::usage, "--set: '{}' is not of the form key=value", text);
    plan.assignments.push_back({text.substr(0, equals), text.substr(equals + 1), "--set"});
  }
  return plan;
}

// Opening a data set costs little without its images, but several rows use the same one.
ImageWidth cached_width() {
  const auto cache = std::make_shared<std::map<std::string, int>>();
  return [cache](const fs::path& data, const TrainSettings& settings) {
    TrainSettings copy = settings;
    std::string key = data.string();
    for (const FieldValue& field : bind_fields(copy, train_fields()))
      if (std::ranges::count(drawing_keys(), field.key) > 0) key += "\n" + field_text(field);
    if (const auto at = cache->find(key); at != cache->end()) return at->second;
    const Dataset set = open_dataset(data, {}, settings, Images::skip);
    for (const Split& split : set.splits)
      if (!split.views.empty()) return (*cache)[key] = split.views[0].camera.width;
    fail(ErrorKind::data, "{}: has no views", data.string());
  };
}

void check_any_data(const std::vector<Job>& jobs, const std::string& root) {
  if (std::ranges::any_of(jobs, [](const Job& job) { return !job.data.empty(); })) return;
  fail(ErrorKind::data,
       "{}: no data of any of the {} runs; the first was looked for in {}; see --scene-folder", root,
       jobs.size(), jobs.front().looked_for);
}

std::string status_text(const Job& job) {
  if (job.data.empty()) return "no data (looked for " + job.looked_for + ")";
  return job.problem.empty() ? "" : "cannot run: " + job.problem;
}

// --dry-run

std::string plan_line(const Job& job, const Estimate& estimate) {
  if (!job.runnable()) return fmt::format("{}: {}", job.id, status_text(job));
  const TrainSettings& s = job.settings;
  std::string text =
      fmt::format("{}: {}, {} px wide, N = {}, up to {} splats, {} iterations of {} views", job.id,
                  job.data.string(), job.width.value_or(0), s.dim, s.cap_max, s.iterations, s.batch);
  if (!estimate.hours) return text + ", time unknown: " + estimate.problem;
  const auto point = [&](const char* when) {
    const Json& step = estimate.plan.at(when);
    return fmt::format("{:.2f} ms at {} splats", step.at("step_ms").get<double>(),
                       step.at("splats").get<std::uint64_t>());
  };
  return text + fmt::format(", {:.3f} h ({}, {}{})", *estimate.hours, point("start"), point("end"),
                            estimate.own ? "" : ", planned for another scene or row");
}

Json jobs_json(const ExperimentSpec& spec, const std::vector<Job>& jobs,
               const std::vector<Estimate>& estimates) {
  Json runs = Json::array();
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    const Estimate& estimate = estimates[i];
    const auto planned = [&](const char* key) { return estimate.hours ? estimate.plan.at(key) : Json(); };
    runs.push_back({{"id", jobs[i].id},
                    {"data", jobs[i].data.string()},
                    {"runnable", jobs[i].runnable()},
                    {"reason", jobs[i].runnable() ? estimate.problem : status_text(jobs[i])},
                    {"not_as_published", changed_settings(jobs[i].published, jobs[i].settings)},
                    {"start", planned("start")},
                    {"end", planned("end")},
                    {"hours", estimate.hours ? Json(*estimate.hours) : Json(nullptr)}});
  }
  return {{"experiment", spec.name}, {"runs", std::move(runs)}};
}

int dry_run(const ExperimentOptions& options, const ExperimentSpec& spec, const std::vector<Job>& jobs) {
  const InterruptGuard guard;
  const TemporaryFolder work;
  EstimateOptions estimate{.executable = this_executable(),
                           .work = work.path(),
                           .device = options.device,
                           .interrupted = [&] { return guard.interrupted(); },
                           .say = {}};
  if (!options.quiet) estimate.say = [](const std::string& line) { remark("{}\n", line); };
  const std::vector<Estimate> estimates = estimate_hours(jobs, estimate);
  if (guard.interrupted()) return kInterruptedExitCode;
  if (options.json) {
    print_json(jobs_json(spec, jobs, estimates));
    return 0;
  }
  double hours = 0;
  std::size_t runnable = 0, unknown = 0;
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    say("{}\n", plan_line(jobs[i], estimates[i]));
    runnable += jobs[i].runnable();
    unknown += jobs[i].runnable() && !estimates[i].hours;
    hours += estimates[i].hours.value_or(0);
  }
  say("\n{} of {} runs have data; {:.3f} hours{} as planned, without loading and evaluation\n", runnable,
      jobs.size(), hours, unknown ? fmt::format(" and {} runs of unknown length", unknown) : "");
  return 0;
}

// The run

void check_out(const ExperimentOptions& options, const fs::path& out, const std::vector<Job>& jobs) {
  if (options.resume || options.overwrite) return;
  for (const Job& job : jobs) {
    const JobFolder folder(out / "runs", job);
    if (path_exists(folder.final_path()) || path_exists(folder.partial_path() / "checkpoint.ubs"))
      fail(ErrorKind::usage,
           "{} has results of {}: go on with --resume, replace them with --overwrite, or choose another "
           "--out",
           out.string(), job.id);
  }
}

// Weights that are named must be good before hours of training; those of the environment need not be meant
// for this, and the table says what is wrong with them.
experiment::MeasureOptions measure_options(const ExperimentOptions& options) {
  experiment::MeasureOptions measure{.fps_views = options.fps_views};
  const char* variable = std::getenv("UBS_LPIPS_WEIGHTS");
  const fs::path weights = !options.lpips_weights.empty() ? options.lpips_weights : variable ? variable : "";
  if (weights.empty()) {
    measure.why_no_lpips = "no weights of VGG16 (--lpips-weights or UBS_LPIPS_WEIGHTS)";
    return measure;
  }
  try {
    const TensorFile file = read_safetensors(lpips_weight_file(weights, "vgg"));
    for (const Layer& layer : lpips_network("vgg").layers)
      if (layer.kind == LayerKind::convolution) file.at(fmt::format("features.{}.weight", layer.number));
    measure.lpips_weights = absolute_path(weights);
  } catch (const Error& error) {
    if (!options.lpips_weights.empty()) throw;
    measure.why_no_lpips = error.what();
    warn("no LPIPS: {}", error.what());
  }
  return measure;
}

int exit_code_of(const std::vector<JobResult>& results) {
  const auto is = [&](JobState state) {
    return std::ranges::any_of(results, [&](const JobResult& r) { return r.state == state; });
  };
  if (is(JobState::interrupted) || is(JobState::pending)) return kInterruptedExitCode;
  const auto failed = std::ranges::find(results, JobState::failed, &JobResult::state);
  return failed == results.end() ? 0 : failed->code;
}

// What a result depends on, as far as it can be known without the images and on a machine without the device.
std::string key_of(const Job& job, const ExperimentOptions& options) {
  return hash_of({{"identity", identity_of(job, options.train_arguments)},
                  {"build", build_id()},
                  {"device", options.device.empty() ? environment("UBS_DEVICE") : options.device}});
}

bool is_finished(const Job& job, const ExperimentOptions& options, const fs::path& out,
                 const std::string& key) {
  std::string remark;
  const auto done = JobFolder(out / "runs", job).completed(identity_of(job, options.train_arguments), remark);
  return done && done->record.value("key", "") == key;
}

// A JSON line for each run that is not finished: this command with --task in the place of --emit-tasks.
int emit_tasks(const ExperimentOptions& options, const std::vector<Job>& jobs, const fs::path& out) {
  const std::string flag = " --emit-tasks";
  std::string command = command_line();
  const std::size_t at = command.find(flag);
  command.erase(at, command.find(' ', at + 1) - at);  // it may be --emit-tasks=true
  std::size_t finished = 0;
  for (const Job& job : jobs) {
    if (!job.runnable()) continue;
    const std::string key = key_of(job, options);
    if (is_finished(job, options, out, key)) {
      ++finished;
      continue;
    }
    say("{}\n", json_text({{"key", key}, {"id", job.id}, {"command", command + " --task " + key}}));
  }
  if (finished > 0) remark("{} runs are finished already\n", finished);
  return 0;
}

// That one, or none where the key belongs to no run: settings, data, build or device have changed.
std::vector<Job> task_of(const ExperimentOptions& options, std::vector<Job> jobs, const fs::path& out) {
  std::erase_if(jobs, [&](const Job& job) { return key_of(job, options) != options.task; });
  if (jobs.empty())
    fail(ErrorKind::usage,
         "--task {}: no run has this key here: other settings, data, build or device; --emit-tasks again",
         options.task);
  if (is_finished(jobs[0], options, out, options.task)) remark("{}: finished already\n", jobs[0].id);
  return jobs;
}

int execute(const ExperimentOptions& options, const ExperimentSpec& spec, const std::vector<Job>& jobs,
            const fs::path& out) {
  files_before_output();
  const bool task = !options.task.empty(), writes = ranks().first() && !task;  // tables
  if (!task) check_out(options, out, jobs);
  ranks().of_first(0);  // before any of them writes
  const experiment::MeasureOptions measure = measure_options(options);
  const std::string device = device_of_rank(options.device);
  choose_device(list_devices(), device);  // before the first run
  Paths data;
  for (const Job& job : jobs) data.push_back(job.data);
  check_apart(out, data);
  const InterruptGuard guard;
  std::optional<FolderLock> lock;  // tasks hold the folders of their runs alone
  if (writes) lock.emplace(out, FolderLock::Children::inherit, kLockPatience);
  if (writes)
    check_output_files({out / "table.md", out / "table.csv", out / "table.json"}, {},
                       options.overwrite || options.resume);
  experiment::RunOptions run{
      .out = out,
      .executable = this_executable(),
      .device = device,
      .train_arguments = options.train_arguments,
      .measure = measure,
      .resume = options.resume || task,
      .environment = {{"commit", commit()}, {"command", command_line()}, {"host", host_name()}},
      .key = [&](const Job& job) { return key_of(job, options); },
      .same_key = task,
      .ranks = &ranks(),
      .date = utc_date,
      .interrupted = [&] { return guard.interrupted(); }};
  if (!options.quiet) run.say = [](const std::string& line) { remark("{}\n", line); };
  std::string text, json;
  const auto save = [&](const std::vector<JobResult>& results) {
    const experiment::Comparison comparison = compare(spec, jobs, results);
    const Occasion occasion{utc_date(), version(), build_id(), commit(), command_line(), options.scale_down};
    text = markdown(spec, jobs, results, comparison, occasion);
    json = json_file_text(to_json(spec, jobs, results, comparison, occasion));
    if (!writes) return;
    write_file_atomically(out / "table.md", text);
    write_file_atomically(out / "table.csv", csv(comparison));
    write_file_atomically(out / "table.json", json);
  };
  run.on_progress = save;
  const std::vector<JobResult> results = run_jobs(jobs, run);
  save(results);
  if (!ranks().first()) return 0;
  say("{}", options.json ? json : text);
  const int code = guard.interrupted() ? kInterruptedExitCode : exit_code_of(results);
  if (code == kInterruptedExitCode)
    warn("interrupted; go on with the same command and --resume");
  else if (code != 0)
    warn("{} runs failed, see the table", std::ranges::count(results, JobState::failed, &JobResult::state));
  return code;
}

int run(const ExperimentOptions& options) {
  const ExperimentSpec spec = load_experiment_spec(options.spec);
  const std::vector<Job> jobs = make_plan(spec, plan_options(options), cached_width());
  if (options.dry_run) return dry_run(options, spec, jobs);
  check_any_data(jobs, options.root);
  const fs::path out = options.out.empty() ? fs::path("out") / spec.name : fs::path(options.out);
  if (options.emit_tasks) return emit_tasks(options, jobs, out);
  return execute(options, spec, options.task.empty() ? jobs : task_of(options, jobs, out), out);
}

void add_list(CLI::App& app, const char* name, std::vector<std::string>& values, const char* help) {
  app.add_option(name, values, help)->delimiter(',')->type_name("A,B,...");
}

}  // namespace

Command add_experiment(CLI::App& root) {
  CLI::App* app =
      root.add_subcommand("experiment", "Run the experiments of the paper where their data are there");
  const auto options = std::make_shared<ExperimentOptions>();
  app->add_option("spec", options->spec, "experiment, such as data_specs/experiments/main_table.yaml")
      ->required()
      ->type_name("FILE");
  app->add_option("root,--root", options->root, "folder that holds the data sets")
      ->required()
      ->type_name("DIR");
  app->add_option("--out", options->out, "output folder: table.md, .csv, .json, runs/ [out/NAME]")
      ->type_name("DIR");
  add_list(*app, "--scenes", options->scenes, "these scenes only: lego, or dnerf/lego");
  add_list(*app, "--rows", options->rows, "these rows (methods) only");
  app->add_option("--scene-folder", options->scene_folders,
                  "where a scene is, relative to --root (repeatable)")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("SCENE=FOLDER");
  app->add_option("--scale-down", options->scale_down,
                  "small version: images / K, splats / K^2, iterations / K; K = 4 where none is given")
      ->expected(0, 1)
      ->default_str(std::to_string(kScaleDown))
      ->check(from_to(1, 64))
      ->type_name("K");
  app->add_option("--set", options->assignments,
                  "a setting of all runs, such as iterations=2000 (repeatable)")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("KEY=VALUE");
  app->add_option("--train-argument", options->train_arguments,
                  "handed to `ubs train` of every run, as --train-argument=--quiet (repeatable)")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("ARG");
  app->add_option("--lpips-weights", options->lpips_weights,
                  "weights of VGG16 for the column LPIPS: a safetensors file, or a folder with "
                  "lpips_vgg.safetensors [UBS_LPIPS_WEIGHTS]")
      ->type_name("FILE|DIR");
  app->add_option("--fps-views", options->fps_views, "test views drawn for the column FPS, 0: none [20]")
      ->check(not_negative())
      ->type_name("N");
  CLI::Option* dry_run = app->add_flag(
      "--dry-run", options->dry_run,
      "only print the runs and the hours that 'ubs plan' expects of each, without --train-argument");
  CLI::Option* emit_tasks =
      app->add_flag("--emit-tasks", options->emit_tasks,
                    "only print a JSON line with a command for each run that is not finished, for job arrays")
          ->excludes(dry_run)
          ->group(kRareGroup);
  CLI::Option* task =
      app->add_option("--task", options->task, "of these commands: the run of this key, and no tables")
          ->excludes(dry_run)
          ->excludes(emit_tasks)
          ->group(kRareGroup)
          ->type_name("KEY");
  CLI::Option* resume = app->add_flag(
      "--resume", options->resume, "keep complete runs of the same settings, go on with the interrupted one");
  app->add_flag("--overwrite", options->overwrite, "replace results of earlier runs")
      ->excludes(resume)
      ->excludes(emit_tasks)
      ->excludes(task);
  add_device_option(*app, options->device);
  app->add_flag("--quiet", options->quiet, "no progress");
  app->add_flag("--json", options->json, "print table.json (with --dry-run the plan) instead of text");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
