// SPDX-License-Identifier: Apache-2.0
// ubs plan: what training a data set, or drawing a model, will need: kernels, memory, intersections, time.
#include <CLI/CLI.hpp>
#include <memory>

#include "host/base/error.hpp"
#include "host/device/registry.hpp"
#include "host/run/open_data.hpp"
#include "host/run/proved_device.hpp"
#include "host/run/training_data.hpp"
#include "host/spec/settings.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/plan_text.hpp"

namespace ubs::tools {
namespace {

struct PlanOptions {
  explicit PlanOptions(CLI::App& app) : settings(app), import(app) {}
  SettingsOptions settings;
  ImportChoice import;
  std::string data, model, split = "test", device;
  bool depth = false, json = false;
};

void print(const PlanOptions& options, TrainSettings settings, const Device& device, const RunPlan& plan) {
  if (options.json) {
    Json json = plan_json(plan, device.info());
    json["data"] = options.data;
    json["model"] = options.model;
    json["device"] = device_json(device.info());
    json["settings"] = ubs::to_json(bind_fields(settings, train_fields()));
    print_json(json);
  } else {
    say("device     {}\n{}", describe(device.info()), plan_text(plan, device.info()));
  }
}

int plan_render(const PlanOptions& options) {
  const LoadedModel loaded = open_model(options.model, options.import.options());
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model);
  const Split split = open_split_for(loaded.offset, options.data, options.split, settings, Images::skip);
  for (const SplatModel& group : loaded.model.groups) check_query(split, group.dim);
  const std::unique_ptr<Device> device =
      open_proved_device(options.device, drawing_use(loaded.model, settings));
  print(options, settings, *device, plan_rendering(*device, settings, split, loaded.model, options.depth));
  return 0;
}

int plan_train(const PlanOptions& options) {
  TrainSettings base;
  base.dim = kAutoInt;
  TrainSettings settings = options.settings.resolve(base);
  Dataset data = open_dataset(options.data, {"train", "test"}, settings, Images::load);
  warn_skipped(data.report);
  const Split train = take_train(data, settings), test = take_test(data, settings);
  const std::unique_ptr<Device> device = open_proved_device(options.device, training_use(settings));
  const SplatModel initial = initial_model(data, train, settings);
  print(options, settings, *device,
        plan_training(*device, settings, train, test, initial, data.points.has_value(), true));
  return 0;
}

int run(const PlanOptions& options) {
  return options.model.empty() ? plan_train(options) : plan_render(options);
}

}  // namespace

Command add_plan(CLI::App& root) {
  CLI::App* app = root.add_subcommand(
      "plan",
      "Say what training a data set, or drawing a model, will need: kernels, memory, intersections, time");
  const auto options = std::make_shared<PlanOptions>(*app);
  app->add_option("data,--data", options->data, "data folder, or packed file")
      ->required()
      ->type_name("DIR|FILE");
  app->get_option("--dim")->description(kAutoDimHelp);
  accept_run_folder(
      *app->add_option("--model", options->model, "plan the drawing of this model instead of a training")
           ->type_name("FILE|DIR"));
  app->add_option("--split", options->split, "with --model: views of this split [test]")->type_name("NAME");
  app->add_flag("--depth", options->depth, "with --model: also the depth channel");
  add_device_option(*app, options->device);
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
