// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/measure.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "host/accuracy/front.hpp"
#include "host/base/error.hpp"
#include "host/base/statistics.hpp"
#include "host/base/stopwatch.hpp"
#include "host/bench/cpu_clock.hpp"
#include "host/device/registry.hpp"
#include "host/spec/settings.hpp"
#include "host/train/run_settings.hpp"

namespace ubs::accuracy {
namespace {

constexpr int kMaxCalls = 64;

// The settings say what the model file says.
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
    fail(ErrorKind::usage, "the form '{}' has other parameters than the model", to_string(variant));
  p.model.variant = variant;
  const View& view = scene.scene.views.views.at(scene.view);
  p.camera = view.camera;
  p.target = planar_target(view.load_image());
  p.background = scene.scene.background;
  p.near_plane = settings.near_plane;
  p.far_plane = settings.far_plane;
  p.eps2d = settings.eps2d;
  p.lambda_dssim = settings.lambda_dssim;
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
    std::unique_ptr<StageRun> run;     // null: does not run here
    std::map<std::string, int> calls;  // by operation, of a sample
    std::map<std::string, std::vector<double>> ms;
  };
  const TruthEntry& truth_of(const Configuration& configuration);
  void prepare(const Configuration& configuration);
  void time_rounds();
  void time_once(Entry& entry);
  void summarise_times();
  double clock_ms() const;
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
      fmt::format("{} {} {} {} {} {}", to_string(variant), settings.near_plane, settings.far_plane,
                  settings.eps2d, settings.lambda_dssim, settings.query_grad);
  const auto found = truths_.find(key);
  if (found != truths_.end()) return found->second;
  say(fmt::format("float64, form {}", to_string(variant)));
  const Problem problem = problem_of(scene_, settings, variant);
  TruthEntry entry{compute_truth(problem), {}};
  if (options_.stages) entry.stages = compute_stage_truth(problem);
  return truths_.emplace(key, std::move(entry)).first->second;
}

void Measurement::prepare(const Configuration& configuration) {
  say(configuration.label);
  Result result{.device = device_.info().name,
                .scene = scene_.name,
                .configuration = configuration.label,
                .truth = truth_name(configuration)};
  Entry entry;
  try {
    const TrainSettings settings = apply(base_, configuration);
    const ModelVariant variant = settings.variant;
    entry.problem = std::make_unique<Problem>(problem_of(scene_, settings, variant));
    const KernelConfig config = kernel_config(entry.problem->model.dim, variant, settings, device_.info());
    entry.run = std::make_unique<StageRun>(device_, config, *entry.problem);
    const TruthEntry& truth = truth_of(configuration);
    ErrorSum image;
    image.add(entry.run->image(), truth.whole.image);
    result.image = {"end to end", "forward", {{"image", image.errors()}}};
    const SplatModel& model = entry.problem->model;
    result.loss_gradient = {
        "end to end, own signs of L1", "iteration",
        group_errors(model.layout(), model.count, entry.run->gradient(), truth.whole.gradient)};
    result.gradient = {"end to end", "iteration",
                       group_errors(model.layout(), model.count, entry.run->gradient_of(truth.whole.v_image),
                                    truth.whole.gradient)};
    // Stage by stage the truth must be of the same form.
    if (options_.stages && configuration.truth.empty()) result.stages = entry.run->stage_errors(truth.stages);
  } catch (const Error& error) {
    constexpr ErrorKind kOwn[] = {ErrorKind::usage, ErrorKind::build, ErrorKind::memory};
    if (std::ranges::find(kOwn, error.kind()) == std::end(kOwn)) throw;
    result.note = error.what();
    std::ranges::replace(result.note, '\n', ' ');
    entry.run.reset();
  }
  results_.push_back(std::move(result));
  entries_.push_back(std::move(entry));
}

double Measurement::clock_ms() const {
  if (options_.processor_time) return bench::cpu_ms();
  return 1e3 * steady_time().seconds();
}

void Measurement::time_once(Entry& entry) {
  for (const std::string& operation : timed_operations()) {
    int& calls = entry.calls[operation];
    if (calls == 0) {
      entry.run->run(operation);
      const double start = clock_ms();
      entry.run->run(operation);
      const double once = std::max(clock_ms() - start, 1e-3);
      calls = std::clamp(static_cast<int>(std::ceil(options_.sample_ms / once)), 1, kMaxCalls);
    }
    const double start = clock_ms();
    for (int i = 0; i < calls; ++i) entry.run->run(operation);
    entry.ms[operation].push_back((clock_ms() - start) / calls);
  }
}

// Each round begins with another configuration, so that no one always follows the same neighbour.
void Measurement::time_rounds() {
  for (std::size_t round = 0; round < options_.rounds; ++round) {
    say(fmt::format("times, round {} of {}", round + 1, options_.rounds));
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      Entry& entry = entries_[(i + round) % entries_.size()];
      if (entry.run) time_once(entry);
    }
    if (stopped()) return;
  }
}

void Measurement::summarise_times() {
  const auto first = std::ranges::find_if(entries_, [](const Entry& e) { return e.run != nullptr; });
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (!entries_[i].run) continue;
    for (const std::string& operation : timed_operations()) {
      const std::vector<double>& own = entries_[i].ms[operation];
      const std::vector<double>& reference = first->ms[operation];
      std::vector<double> ratios;
      for (std::size_t r = 0; r < std::min(own.size(), reference.size()); ++r)
        ratios.push_back(own[r] / std::max(reference[r], 1e-6));
      const Summary summary = summarise(ratios);
      results_[i].times.push_back({operation, summarise(own).median, summary.median, summary.uncertainty()});
    }
  }
}

std::vector<Result> Measurement::run() {
  for (const Configuration& configuration : options_.configurations) {
    if (stopped()) break;
    prepare(configuration);
  }
  if (std::ranges::none_of(entries_, [](const Entry& e) { return e.run != nullptr; })) {
    if (results_.empty()) return {};
    fail(ErrorKind::usage, "no configuration runs on {}: {}", device_.info().name, results_.front().note);
  }
  time_rounds();
  summarise_times();
  mark_fronts(results_);
  return std::move(results_);
}

// Calls do() for the results of each (device, scene, truth), as their indices.
template <typename Function>
void by_group(const std::vector<Result>& results, const Function& act) {
  std::map<std::string, std::vector<std::size_t>> groups;
  for (std::size_t i = 0; i < results.size(); ++i)
    if (results[i].note.empty() && !results[i].times.empty())
      groups[results[i].device + '\n' + results[i].scene + '\n' + results[i].truth].push_back(i);
  for (const auto& [name, members] : groups) act(members);
}

double geometric_mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += std::log(std::max(v, 1e-300));
  return std::exp(sum / static_cast<double>(values.size()));
}

Result mean_of(const std::vector<const Result*>& all) {
  Result mean = *all.front();
  mean.scene = "all";
  mean.stages.clear();
  const auto average = [&](double& to, const auto& get) {
    std::vector<double> values;
    for (const Result* r : all) values.push_back(get(*r));
    to = geometric_mean(values);
  };
  // The worst group of each scene, which need not be the same one.
  mean.gradient.quantities = mean.loss_gradient.quantities = {{"worst group", {}}};
  Errors &image = mean.image.quantities[0].errors, &gradient = mean.gradient.quantities[0].errors,
         &of_loss = mean.loss_gradient.quantities[0].errors;
  average(image.relative, [](const Result& r) { return r.image_error(); });
  average(image.absolute, [](const Result& r) { return r.image.quantities[0].errors.absolute; });
  image.typical = image.relative;
  const auto average_all = [&](Errors& to, const StageErrors Result::*which) {
    average(to.relative, [&](const Result& r) { return most_relative((r.*which).quantities); });
    average(to.typical, [&](const Result& r) { return worst((r.*which).quantities).errors.typical; });
  };
  average_all(gradient, &Result::gradient);
  average_all(of_loss, &Result::loss_gradient);
  for (std::size_t i = 0; i < mean.times.size(); ++i) {
    average(mean.times[i].ms, [&](const Result& r) { return r.times[i].ms; });
    average(mean.times[i].ratio, [&](const Result& r) { return r.times[i].ratio; });
    double square = 0;
    for (const Result* r : all) square += r->times[i].uncertainty * r->times[i].uncertainty;
    mean.times[i].uncertainty = std::sqrt(square) / static_cast<double>(all.size());
  }
  return mean;
}

}  // namespace

const OperationTime& Result::time(const std::string& operation) const {
  const auto found = std::ranges::find(times, operation, &OperationTime::operation);
  if (found == times.end()) fail(ErrorKind::internal, "no time of '{}' for '{}'", operation, configuration);
  return *found;
}

std::vector<Result> measure(Device& device, const NamedScene& scene, const MeasureOptions& options) {
  return Measurement(device, scene, options).run();
}

void mark_fronts(std::vector<Result>& results) {
  by_group(results, [&](const std::vector<std::size_t>& members) {
    std::vector<Point> image, gradient;
    for (const std::size_t i : members) {
      const Result& r = results[i];
      image.push_back({r.time("forward").ratio, r.time("forward").uncertainty, r.image_error()});
      gradient.push_back(
          {r.time("iteration").ratio, r.time("iteration").uncertainty, r.gradient_error().errors.typical});
    }
    const std::vector<bool> of_image = pareto_front(image), of_gradient = pareto_front(gradient);
    for (std::size_t k = 0; k < members.size(); ++k) {
      results[members[k]].image_front = of_image[k];
      results[members[k]].gradient_front = of_gradient[k];
    }
  });
}

void add_means(std::vector<Result>& results) {
  std::vector<std::pair<std::string, std::vector<const Result*>>> groups;  // in order of first appearance
  for (const Result& r : results) {
    if (!r.note.empty() || r.times.empty()) continue;
    const std::string key = r.device + '\n' + r.configuration;
    auto found = std::ranges::find(groups, key, [](const auto& g) { return g.first; });
    if (found == groups.end()) found = groups.insert(groups.end(), {key, {}});
    found->second.push_back(&r);
  }
  std::vector<Result> means;
  for (const auto& [key, members] : groups)
    if (members.size() > 1) means.push_back(mean_of(members));
  results.insert(results.end(), means.begin(), means.end());
  mark_fronts(results);
}

}  // namespace ubs::accuracy
