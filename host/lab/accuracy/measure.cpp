// SPDX-License-Identifier: Apache-2.0
#include "host/lab/accuracy/measure.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "host/base/error.hpp"
#include "host/base/statistics.hpp"
#include "host/base/stopwatch.hpp"
#include "host/device/registry.hpp"
#include "host/lab/accuracy/truth.hpp"
#include "host/settings/fields.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/target_loss.hpp"

namespace ubs::accuracy {
namespace {

constexpr int kMaxCalls = 64;

// Returns the settings with the variant of the model file.
TrainSettings with_variant(TrainSettings settings, const ModelVariant& variant) {
  const auto fields = bind_fields(settings, train_fields());
  for (const auto& [key, value] : non_default_switches(variant)) set_field(fields, key, value, "model");
  return settings;
}

Problem problem_of(const NamedScene& scene, const TrainSettings& settings, const ModelVariant& variant) {
  Problem p;
  p.model = scene.scene.model;
  check_variant(p.model.dim, variant);
  if (ParameterLayout(p.model.dim, variant).property_names() != p.model.layout().property_names())
    fail(ErrorKind::usage, "the variant '{}' does not have the parameters of the model", to_string(variant));
  p.model.variant = variant;
  const View& view = scene.scene.views.views.at(scene.view);
  p.camera = view.camera;
  p.target = planar_target(view.load_image());
  p.background = scene.scene.background;
  p.near_plane = planes_of(settings).near;
  p.far_plane = planes_of(settings).far;
  p.eps2d = settings.eps2d;
  p.loss = loss_weights(settings);
  p.query_grad = settings.query_grad;
  return p;
}

struct TruthEntry {
  Truth whole;
  StageTruth stages;
};

class Measurement {
 public:
  Measurement(Device& device, const NamedScene& scene, const MeasureOptions& options)
      : device_(device),
        scene_(scene),
        options_(options),
        base_(with_variant(scene.base, scene.scene.model.variant)) {}

  std::vector<Result> run();

 private:
  struct Entry {
    std::unique_ptr<Problem> problem;
    std::unique_ptr<check::StageRun> run;  // null if the configuration does not run here
    std::map<std::string, int> calls;      // calls per sample, by stage
    std::map<std::string, std::vector<double>> ms;
  };
  const TruthEntry& truth_of(const Configuration& configuration);
  void prepare(const Configuration& configuration);
  void time_rounds();
  void time_once(Entry& entry, const Result& result);
  bool stopped() const { return options_.stop && options_.stop(); }
  void say(const std::string& text) const {
    if (options_.on_progress) options_.on_progress(text);
  }

  Device& device_;
  const NamedScene& scene_;
  const MeasureOptions& options_;
  TrainSettings base_;
  std::map<std::string, TruthEntry> truths_;
  std::vector<Entry> entries_;
  std::vector<Result> results_;
};

const TruthEntry& Measurement::truth_of(const Configuration& configuration) {
  const ModelVariant variant = truth_variant(base_, configuration);
  const TrainSettings settings = apply(base_, configuration);
  const std::string key =
      fmt::format("{} {} {} {} {} {}", to_string(variant), planes_of(settings).near, planes_of(settings).far,
                  settings.eps2d, settings.lambda_dssim, settings.query_grad);
  const auto found = truths_.find(key);
  if (found != truths_.end()) return found->second;
  say(fmt::format("computing the float64 reference of the variant {}", to_string(variant)));
  const Problem problem = problem_of(scene_, settings, variant);
  return truths_.emplace(key, TruthEntry{compute_truth(problem), compute_stage_truth(problem)}).first->second;
}

void Measurement::prepare(const Configuration& configuration) {
  say(configuration.label);
  Result result{.form = configuration.label,
                .truth = truth_name(configuration),
                .dim = scene_.scene.model.dim,
                .scene = scene_.name,
                .device = device_.info().name};
  Entry entry;
  try {
    const TrainSettings settings = apply(base_, configuration);
    const ModelVariant variant = settings.variant;
    entry.problem = std::make_unique<Problem>(problem_of(scene_, settings, variant));
    const KernelConfig config = kernel_config(entry.problem->model.dim, variant, settings, device_.info());
    entry.run = std::make_unique<check::StageRun>(device_, config, *entry.problem);
    const TruthEntry& truth = truth_of(configuration);
    result.contributions = truth.whole.contributions;
    check::ErrorSum image;
    image.add(entry.run->image(), truth.whole.image);
    result.stages.push_back({{"forward", {{"image", image.errors()}}}});
    const SplatModel& model = entry.problem->model;
    result.stages.push_back({{"iteration", check::group_errors(model.layout(), model.count,
                                                               entry.run->gradient_of(truth.whole.v_image),
                                                               truth.whole.gradient)}});
    // Single stages can only be compared if the float64 reference has the same variant.
    if (configuration.truth.empty())
      for (check::StageErrors& stage : entry.run->stage_errors(truth.stages))
        result.stages.push_back({stage});
  } catch (const Error& error) {
    constexpr ErrorKind kOwn[] = {ErrorKind::usage, ErrorKind::build, ErrorKind::memory};
    if (std::ranges::find(kOwn, error.kind()) == std::end(kOwn)) throw;
    result.note = error.what();
    std::ranges::replace(result.note, '\n', ' ');
    result.stages.clear();
    entry.run.reset();
  }
  results_.push_back(std::move(result));
  entries_.push_back(std::move(entry));
}

void Measurement::time_once(Entry& entry, const Result& result) {
  for (const TimedErrors& stage : result.stages) {
    const auto time = [&](int calls) {
      const Stopwatch watch;
      for (int i = 0; i < calls; ++i) entry.run->run(stage.stage);
      return watch.milliseconds() / calls;
    };
    int& calls = entry.calls[stage.stage];
    if (calls == 0) {
      time(1);
      calls =
          std::clamp(static_cast<int>(std::ceil(options_.sample_ms / std::max(time(1), 1e-3))), 1, kMaxCalls);
    }
    entry.ms[stage.stage].push_back(time(calls));
  }
}

// Each round starts with a different configuration, so that no configuration always runs after the same one.
void Measurement::time_rounds() {
  for (std::size_t round = 0; round < options_.rounds; ++round) {
    say(fmt::format("measuring times, round {} of {}", round + 1, options_.rounds));
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      const std::size_t which = (i + round) % entries_.size();
      if (entries_[which].run) time_once(entries_[which], results_[which]);
    }
    if (stopped()) return;
  }
}

std::vector<Result> Measurement::run() {
  for (const Configuration& configuration : options_.configurations) {
    if (stopped()) break;
    prepare(configuration);
  }
  if (std::ranges::none_of(entries_, [](const Entry& e) { return e.run != nullptr; })) {
    if (results_.empty()) return {};
    fail(ErrorKind::usage, "no configuration can be run on {}: {}", device_.info().name,
         results_.front().note);
  }
  time_rounds();
  for (std::size_t i = 0; i < entries_.size(); ++i)
    for (TimedErrors& stage : results_[i].stages) stage.ms = summarise(entries_[i].ms[stage.stage]).median;
  return std::move(results_);
}

}  // namespace

std::vector<Result> measure(Device& device, const NamedScene& scene, const MeasureOptions& options) {
  return Measurement(device, scene, options).run();
}

}  // namespace ubs::accuracy
