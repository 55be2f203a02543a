// SPDX-License-Identifier: Apache-2.0
// ubs plan: predicts the kernels, the memory, the number of intersections and the time that training on a
// data set, or rendering a model, needs.
#include <CLI/CLI.hpp>
#include <map>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/text.hpp"
#include "host/device/registry.hpp"
#include "host/run/open_data.hpp"
#include "host/run/training_run.hpp"
#include "host/run/verified_device.hpp"
#include "host/settings/fields.hpp"
#include "host/train/kernel_warm_up.hpp"
#include "host/train/rank_plan.hpp"
#include "host/train/run_settings.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/plan_text.hpp"
#include "tools/train_start.hpp"

namespace ubs::tools {
namespace {

struct PlanOptions {
  explicit PlanOptions(CLI::App& app) : settings(app) {}
  SettingsOptions settings;
  std::string data, model, split = "test", device;
  bool depth = false, json = false;
  std::vector<int> ranks;
  std::vector<double> splats;
  RankNetwork network;
  std::string costs;
};

Json planned_json(const PlanOptions& options, TrainSettings settings, const Device& device,
                  const RunPlan& plan) {
  Json json = plan_json(plan, device.info());
  json["data"] = options.data;
  json["model"] = options.model;
  json["device"] = device_json(device.info());
  json["settings"] = ubs::to_json(bind_fields(settings, train_fields()));
  return json;
}

void say_plan(const Device& device, const RunPlan& plan) {
  say("device     {}\n{}", describe(device.info()), plan_text(plan, device.info()));
}

int plan_render(PlanOptions& options) {
  options.settings.limit(drawing_keys(), "only applies to training: remove --model");
  // Invalid settings are reported before the model is read.
  const RunData run = use_run_data(options.model, options.data, options.settings.resolve());
  const LoadedModel loaded = open_model(options.model);
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, run);
  const Split split =
      open_split_for(loaded.offset, options.data, options.split, settings, Images::skip, run.opened);
  for (const SplatModel& group : loaded.model.groups) check_query(split, group.dim);
  const std::unique_ptr<Device> device =
      open_verified_device(options.device, drawing_use(loaded.model, settings));
  const RunPlan plan = plan_rendering(*device, settings, split, loaded.model, options.depth);
  if (options.json)
    print_json(planned_json(options, settings, *device, plan));
  else
    say_plan(*device, plan);
  return 0;
}

std::unique_ptr<TrainingRun> open_training(const PlanOptions& options) {
  const TrainSettings asked = options.settings.resolve();
  auto data = std::make_shared<Dataset>(open_dataset(options.data, {"train", "test"}, asked, Images::load));
  warn_skipped(data->report);
  auto run = std::make_unique<TrainingRun>(std::move(data), asked);
  run->warn_about_test();
  return run;
}

int plan_train(const PlanOptions& options) {
  const std::unique_ptr<TrainingRun> run = open_training(options);
  const std::unique_ptr<Device> device = open_verified_device(options.device, run->use());
  const RunPlan plan = plan_training(*device, run->plan(), run->train(), run->test(), run->initial());
  const TrainSettings settings = run->plan().recorded();
  if (options.json) {
    Json json = planned_json(options, settings, *device, plan);
    json["budget_seconds"] = run->time_limit() > 0 ? Json(run->time_limit()) : Json();
    print_json(json);
    return 0;
  }
  if (run->time_limit() > 0)
    say("schedule   {} iterations, at most {} splats\n"
        "           'ubs train' shortens this schedule if it would take longer than {}\n",
        settings.iterations, settings.cap_max, duration_text(run->time_limit()));
  say_plan(*device, plan);
  return 0;
}

// Calls `use` with the name and the value of each linear cost in RankCosts: a fixed time, and a time per
// splat.
template <typename Costs, typename Use>
void for_lines(Costs& costs, const Use& use) {
  use("whole", costs.whole);
  use("project", costs.project);
  use("draw", costs.draw);
  use("gradient", costs.gradient);
  use("update", costs.update);
}

Json costs_json(const RankCosts& costs) {
  Json json = Json::object();
  for_lines(costs, [&](const char* name, const LinearCost& line) {
    json[name] = {{"fixed_ms", line.fixed}, {"ms_a_million", 1e6 * line.each}};
  });
  json["drawn_share"] = costs.drawn_share;
  json["intersections_per_drawn"] = costs.intersections_per_drawn;
  return json;
}

RankCosts read_costs(const std::string& path) {
  const Json file = parse_own_json(read_text_file(path), path);
  RankCosts costs;
  const auto number = [&](const Json& json, const char* key) {
    const double value = json.at(key).get<double>();
    if (!(value >= 0)) fail(ErrorKind::data, "{}: '{}' is {}; it must be at least 0", path, key, value);
    return value;
  };
  try {
    const Json& json = file.contains("costs") ? file.at("costs") : file;
    for_lines(costs, [&](const char* name, LinearCost& line) {
      line = {number(json.at(name), "fixed_ms"), 1e-6 * number(json.at(name), "ms_a_million")};
    });
    costs.drawn_share = number(json, "drawn_share");
    costs.intersections_per_drawn = number(json, "intersections_per_drawn");
  } catch (const nlohmann::json::exception&) {
    fail(ErrorKind::data, "{}: this is not the output of 'ubs plan --ranks ... --json'", path);
  }
  return costs;
}

int plan_ranks(const PlanOptions& options) {
  constexpr int kMaxMeasured = 1'000'000;  // maximum number of splats for the measurement
  const std::unique_ptr<TrainingRun> run = open_training(options);
  const Plan plan = run->plan();
  const TrainSettings& settings = plan.settings();
  const std::unique_ptr<Device> device = open_verified_device(options.device, run->use());
  const MemoryQuestion memory = memory_question(settings, run->train(), run->test(), device->info(), 1);
  const SplatModel initial = run->initial();
  const RankCosts costs =
      options.costs.empty()
          ? measure_rank_costs(
                *device, settings, run->train(),
                copies(initial, static_cast<std::size_t>(std::min(kMaxMeasured, settings.cap_max))))
          : read_costs(options.costs);
  std::vector<double> splats = options.splats;
  if (splats.empty()) splats.push_back(settings.cap_max);
  Json rows = Json::array();
  std::string text =
      fmt::format("{:>12} {:>6} {:>12} {:>11} {:>11} {:>10} {:>12} {:>13}\n", "splats", "ranks", "per rank",
                  "step [ms]", "network", "speed-up", "sent [MB]", "memory [MiB]");
  for (const double count : splats) {
    const double alone = predict_ranks(costs, count, settings.batch, 1, options.network, memory).step_ms();
    for (const int ranks : options.ranks) {
      const RankPrediction p = predict_ranks(costs, count, settings.batch, ranks, options.network, memory);
      text += fmt::format("{:>12.0f} {:>6} {:>12.0f} {:>11.2f} {:>11.2f} {:>10.2f} {:>12.2f} {:>13.1f}\n",
                          count, ranks, p.splats, p.step_ms(), p.network_ms, alone / p.step_ms(),
                          1e-6 * p.sent_bytes, p.device_bytes / (1 << 20));
      rows.push_back({{"splats", count},
                      {"ranks", ranks},
                      {"splats_of_a_rank", p.splats},
                      {"step_ms", p.step_ms()},
                      {"network_ms", p.network_ms},
                      {"sent_bytes", p.sent_bytes},
                      {"device_bytes", p.device_bytes}});
    }
  }
  if (options.json)
    print_json({{"data", options.data},
                {"batch", settings.batch},
                {"gigabytes_per_second", options.network.gigabytes_per_second},
                {"latency_us", options.network.latency_us},
                {"device", device_json(device->info())},
                {"costs", costs_json(costs)},
                {"predictions", std::move(rows)}});
  else
    say("batch {}, {} GB/s, {} us; network: time that does not overlap with computation; sent: per step, by "
        "the rank that sends most\n{}",
        settings.batch, options.network.gigabytes_per_second, options.network.latency_us, text);
  return 0;
}

int run(PlanOptions& options) {
  if (!options.ranks.empty() && !options.model.empty())
    fail(ErrorKind::usage, "--ranks only applies to training: remove --model");
  if (!options.model.empty()) return plan_render(options);
  if (options.data.empty())
    fail(ErrorKind::usage, "no data folder given: ubs plan FOLDER (see 'ubs plan --help')");
  return options.ranks.empty() ? plan_train(options) : plan_ranks(options);
}

}  // namespace

Command add_plan(CLI::App& root) {
  CLI::App* app = root.add_subcommand("plan",
                                      "Predict what training on a data set, or rendering a model, needs: "
                                      "kernels, memory, intersections, time");
  const auto options = std::make_shared<PlanOptions>(*app);
  app->add_option("data,--data", options->data, "data folder, or packed file [with --model: data of its run]")
      ->type_name("DIR|FILE");
  CLI::Option* model = add_model_option(*app, "--model", options->model,
                                        "predict the rendering of this model or run instead of training");
  app->add_option("--split", options->split, "with --model: views of this split [test]")->type_name("NAME");
  app->add_flag("--depth", options->depth, "with --model: also render the depth channel");
  for (const char* drawing : {"--split", "--depth"}) app->get_option(drawing)->needs(model);
  add_device_option(*app, options->device);
  CLI::Option* ranks = app->add_option("--ranks", options->ranks,
                                       "estimate the step time when this many MPI processes share the "
                                       "training, each with a device like this one (docs/cluster.md)")
                           ->delimiter(',')
                           ->check(from_to(1, 65536))
                           ->type_name("R,...");
  app->add_option("--link", options->network.gigabytes_per_second,
                  "with --ranks: network bandwidth of each process in GB/s [10]")
      ->needs(ranks)
      ->check(positive())
      ->type_name("GB/S");
  app->add_option("--latency", options->network.latency_us,
                  "with --ranks: latency of a message in microseconds [5]")
      ->needs(ranks)
      ->check(not_negative())
      ->type_name("US");
  app->add_option("--splats", options->splats,
                  "with --ranks: number of splats of the model, such as 10M [cap_max]")
      ->needs(ranks)
      ->delimiter(',')
      ->transform(CLI::AsNumberWithUnit(std::map<std::string, double>{{"K", 1e3}, {"M", 1e6}, {"G", 1e9}}))
      ->check(from_to(1.0, 1e12))
      ->type_name("COUNT,...");
  app->add_option("--costs", options->costs,
                  "with --ranks: use the step costs of another device instead of measuring this one; FILE is "
                  "the output of 'ubs plan --ranks ... --json' on that device")
      ->needs(ranks)
      ->type_name("FILE");
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
