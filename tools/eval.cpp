// SPDX-License-Identifier: Apache-2.0
// ubs eval: image quality of a model on the views of a split.
#include <CLI/CLI.hpp>
#include <chrono>
#include <memory>

#include "host/base/file.hpp"
#include "host/train/evaluate.hpp"
#include "tools/commands.hpp"
#include "tools/common/dataset.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/output.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

constexpr std::size_t kTargetBudgetBytes = std::size_t{1} << 30;

struct Options : ModelOptions {
  explicit Options(CLI::App& app) : ModelOptions(app, drawing_keys()) {}
  std::string out;
  bool json = false;
};

int run(const Options& options) {
  const TrainSettings settings = options.settings.resolve();
  const LoadedModel loaded = open_model(options.model);
  const SplatModel& model = loaded.model;
  const Split split = open_split_for(loaded.offset, options.data, options.split, settings, Images::load);
  require_images(split);
  ModelSession session(options.device, model, split, settings, false);
  TargetImages targets(session.device(), kTargetBudgetBytes,
                       static_cast<std::size_t>(settings.image_cache_mb) << 20);
  targets.add(split);

  const auto start = std::chrono::steady_clock::now();
  const Metrics metrics = evaluate(session.device(), session.stages(), session.renderer(),
                                   session.model().view(), session.settings(), split.views, targets, 0);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

  Json json{
      {"version", version()},  {"build", build_id()},    {"model", options.model},
      {"data", options.data},  {"split", options.split}, {"dim", model.dim}, {"variant", to_string(model.variant)},
      {"work", to_string(work_switches(settings))},
      {"splats", model.count}, {"seconds", seconds},     {"device", device_json(session.device().info())}};
  json.update(metrics_json(metrics));
  if (!options.out.empty()) write_file_atomically(options.out, json_file_text(json));
  if (options.json) {
    print_json(json);
    return 0;
  }
  for (const ViewMetrics& view : metrics.views) fmt::print("{:<24} {}\n", view.name, metrics_text(view));
  fmt::print("{} views of '{}': {}; N = {}, {} splats, {:.2f} s on {}\n", metrics.views.size(), options.split,
             metrics_text(metrics.mean), model.dim, model.count, seconds, describe(session.device().info()));
  return 0;
}

}  // namespace

Command add_eval(CLI::App& root) {
  CLI::App* app = root.add_subcommand("eval", "Measure a model against the images of a split");
  const auto options = std::make_shared<Options>(*app);
  app->add_option("--out", options->out, "JSON file to write the measurements to")->type_name("FILE");
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
