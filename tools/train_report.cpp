// SPDX-License-Identifier: Apache-2.0
#include "tools/train_report.hpp"

#include <algorithm>

#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/look/report/run_record.hpp"
#include "host/settings/fields.hpp"
#include "tools/common/program_version.hpp"

namespace ubs::tools {
namespace {

// Minutes per stage are estimated from sampled iterations (host/train/timed_stages.hpp). "other" is the rest
// of the time: images, the host, and work between stages.
Json minutes_json(const Trainer& trainer, double spent) {
  Json stages = Json::object();
  double known = 0;
  std::uint64_t samples = 0;
  for (const StageTime& time : trainer.scene().stages().times()) {
    stages[std::string(time.stage)] = time.seconds / 60;
    known += time.seconds;
    if (time.stage == "raster_forward") samples = time.sampled;
  }
  if (spent > 0) stages["preparation"] = spent / 60;
  stages["other"] = std::max(0.0, trainer.seconds() - spent - known) / 60;
  return {{"total", trainer.seconds() / 60}, {"sampled_views", samples}, {"stages", std::move(stages)}};
}

// Difference between the PSNR of training views and that of test views, in dB. If it is larger than this, a
// line of the summary reports it (docs/training.md).
constexpr double kOverfit = 6;

// Returns the PSNR of the test views that is comparable with that of the training views. Training views are
// rendered with learnt poses and appearances. So if the run has also measured the test views from fitted
// poses or with fitted appearances, the result is the highest of these values.
double comparable_psnr(const ViewMetrics& mean) {
  double psnr = mean.psnr_channel_mean;
  for (const auto& fit : {mean.fitted, mean.posed})
    if (fit) psnr = std::max(psnr, fit->psnr_channel_mean);
  return psnr;
}

}  // namespace

std::string overfit_text(const Outcome& outcome) {
  if (!outcome.evaluation || !outcome.train || outcome.train->views.empty()) return {};
  const double train = comparable_psnr(outcome.train->mean);
  const double above = train - comparable_psnr(outcome.evaluation->metrics.mean);
  if (!(above > kOverfit)) return {};
  return fmt::format(
      "training views have {:.2f} dB, {:.1f} dB more than the test views: more images between the existing "
      "ones help most, and training longer does not help (docs/training.md)",
      train, above);
}

void print_start(const TrainingRun& run, const Device& device) {
  print_report(run.report());
  const Camera& camera = run.train().views[0].camera;
  say("{} train and {} test views of {}x{}, N = {}\ndevice   {}\n", run.train().views.size(),
      run.test().views.size(), camera.width, camera.height, run.plan().settings().dim,
      describe(device.info()));
  flush_out();
}

void print_summary(const Start& start, const RunFolder& folder, Trainer& trainer, const Outcome& outcome,
                   std::uint64_t peak_bytes, std::size_t renders) {
  const auto& early = trainer.completed_from();
  say("{} after {} iterations, {:.1f} s: {} splats\n",
      outcome.interrupted ? "interrupted"
      : early             ? "finished early"
                          : "finished",
      trainer.iteration(), trainer.seconds(), trainer.splats());
  if (const auto& evaluation = outcome.evaluation)
    say("test     {}{}\n", metrics_text(evaluation->metrics.mean),
        evaluation->iteration == trainer.iteration()
            ? ""
            : fmt::format(", after iteration {}", evaluation->iteration));
  if (const std::string overfit = overfit_text(outcome); !overfit.empty()) say("overfit  {}\n", overfit);
  say("memory   {}, peak {:.1f} MiB\n", summary(trainer.memory_plan()),
      static_cast<double>(peak_bytes) / (1 << 20));
  say("model    {}\nmetrics  {}\n", folder.model().string(), folder.metrics().string());
  if (renders > 0) say("renders  {} (ground truth | render)\n", folder.renders().string());
  say("settings and log  {}\n", start.out);
  const std::string run = shell_word(start.out);
  if (outcome.interrupted && !outcome.saved)
    say("next     the state was not saved, so this model cannot be trained further (the reason is above)\n");
  else if (outcome.interrupted)
    say("next     ubs train --resume {}{}\n", run,
        early ? fmt::format(" (the run continues after iteration {}, as if it had not been interrupted)",
                            early->iteration)
        : trainer.scene().ranks().size() == 1 ? " (--budget +1m completes the schedule within a minute)"
                                              : "");
  else
    say("next     ubs report {0} (HTML report), ubs view {0} (in the browser), ubs render {0} --video "
        "flight.mp4\n",
        run);
  if (!outcome.interrupted && path_exists(folder.continuation()))
    say("longer   ubs train --resume {} --budget +5m\n", run);
}

namespace {

Json actual_json(Trainer& trainer, std::uint64_t peak_bytes, double spent) {
  return {{"seconds", trainer.seconds()},
          {"step_ms", 1e3 * (trainer.seconds() - spent) / std::max(1, trainer.iteration())},
          {"mean_intersections", trainer.scene().intersections().mean()},
          {"most_intersections", trainer.scene().intersections().most},
          {"memory_bytes", peak_bytes}};
}

}  // namespace

Json run_json(const Start& start, TrainingRun& run, const Device& device, std::uint64_t peak_bytes,
              double spent, const Outcome& outcome) {
  Trainer& trainer = run.trainer();
  TrainSettings settings = run.plan().recorded();
  Json json{{"version", version()},
            {"build", build_id()},
            {"data", start.data},
            {"data_from_run", data_from_run(start.data, start.out)},
            {"interrupted", outcome.interrupted},
            {"ended_early", nullptr},
            {"dim", settings.dim},
            {"splats", trainer.splats()},
            {"iterations", trainer.iteration()},
            {"seconds", trainer.seconds()},
            {"minutes", minutes_json(trainer, spent)},
            {"resumed_from", nullptr},
            {"rollbacks", trainer.rollbacks()},
            {"dropped_splats", trainer.dropped()},
            {"peak_device_bytes", peak_bytes},
            {"predicted_device_bytes", trainer.memory_plan().total()},
            {"extent", trainer.scene().schedule().extent() * settings.unit},
            {"device", device_json(device.info())},
            {"settings", to_json(bind_fields(settings, train_fields()))},
            {"actual", actual_json(trainer, peak_bytes, spent)},
            {"test", nullptr}};
  if (const int ranks = trainer.scene().ranks().size(); ranks > 1) {
    json["ranks"] = ranks;
    json["views_by_rank"] = trainer.scene().shared()->deal().counts();
    json["bytes_sent_by_first_rank"] = trainer.scene().shared()->bytes_sent();
  }
  if (const auto& from = trainer.completed_from())
    json["ended_early"] = {{"iteration", from->iteration}, {"seconds", from->seconds}};
  if (start.checkpoint) json["resumed_from"] = start.checkpoint->state.iteration;
  if (const auto& evaluation = outcome.evaluation) {
    json["test"] = {{"iteration", evaluation->iteration}, {"seconds", evaluation->seconds}};
    json["test"].update(metrics_json(evaluation->metrics));
  }
  if (outcome.train) json["train"] = metrics_json(*outcome.train);
  return json;
}

}  // namespace ubs::tools
