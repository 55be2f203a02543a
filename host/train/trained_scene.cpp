// SPDX-License-Identifier: Apache-2.0
#include "host/train/trained_scene.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/device/operations.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/train/shared_splats.hpp"
#include "host/train/target_loss.hpp"

namespace ubs {
namespace {

// Returns the settings for a run that starts from this model: cap_max is increased to the number of splats of
// the model if it is smaller.
TrainSettings settings_for(TrainSettings settings, const SplatModel& initial, const Communicator& ranks) {
  check_initial(settings, initial);
  if (ranks.size() > 1 && settings.refine_cameras != RefineCameras::none)
    fail(ErrorKind::usage, "refine_cameras is not supported with several MPI processes");
  settings.cap_max = std::max(settings.cap_max, static_cast<int>(initial.count));
  return settings;
}

// Returns the scene extent. If all cameras have the same position, no length can be computed from them, so
// the extent is 1 unit.
double extent_of(const Split& train) {
  return at_one_place(cameras_of(train)) ? 1 : scene_extent(train.views);
}

}  // namespace

TrainedScene::TrainedScene(Device& device, const TrainSettings& settings, const Split& train,
                           const Split& test, const SplatModel& initial, Communicator& ranks,
                           const TimeSource& time)
    : ranks_(ranks),
      device_(device),
      schedule_(settings_for(settings, initial, ranks), initial.count, extent_of(train)),
      views_(device, this->settings(), train, test),
      stages_(std::make_unique<TimedStages>(
          device, make_stages(device, training_config(this->settings(), device.info())), time)),
      splats_(make_trained_splats(ranks, device, *stages_, initial,
                                  static_cast<std::size_t>(this->settings().cap_max))),
      passes_(make_view_passes(ranks, device, *stages_, views_, *splats_,
                               ubs::render_settings(this->settings()))),
      sky_(device, this->settings(), *passes_, views_.batch()),
      cameras_(device, *stages_, views_, *passes_, *splats_, time),
      rates_(device, "learning rates", static_cast<std::size_t>(splats_->model().rows())),
      losses_(device, this->settings()) {
  if (this->settings().refine_cameras != RefineCameras::none) views_.refine_cameras(initial);
  set_cameras(views_.cameras());
}

TrainSettings TrainedScene::settings_with_learnt_background() const {
  TrainSettings drawn = settings();
  drawn.background = learnt_background(drawn.background, sky_.state());
  return drawn;
}

MemoryPlan TrainedScene::memory_plan(int iteration) const {
  MemoryQuestion question =
      memory_question(settings(), views_.train(), views_.test(), device_.info(), splats_->model().stride());
  question.intersections = passes_->renderer().intersection_capacity();
  question.refinement = schedule_.ever_refines_by(iteration);
  return plan_memory(question);
}

// ---- One iteration ----

int TrainedScene::differentiate(const TrainProgress& progress) {
  stages_->begin_iteration(progress.iteration, schedule_.refines(progress.iteration));
  use_level_of(progress.iteration);
  sky_.clear();
  return passes_->run(views_of(progress));
}

void TrainedScene::use_level_of(int iteration) {
  if (views_.use_factor(views_.factor_at(schedule_.work(), iteration))) set_cameras(views_.cameras());
}

// Returns the views of this iteration. For the last view, only the gradient of the records is computed,
// because update() computes the gradient of the parameters together with the Adam step. In iterations that
// refine, the complete gradient is computed.
StepViews TrainedScene::views_of(const TrainProgress& progress) {
  const std::uint64_t first = views_.first_draw(progress.iteration);
  return {.first = first,
          .end = first + views_.batch(),
          .left_out = progress.skipped_draws,
          .uncounted = lists_uncounted(settings(), device_.info()),
          .keeps_records = !schedule_.refines(progress.iteration),
          .loss = [this](std::uint64_t draw) {
            ImageLoss loss = views_.loss(passes_->renderer(), draw, losses_.view());
            loss.sums_offset = static_cast<std::uint32_t>(losses_.offset(draw));
            stages_->image_loss(loss);
            sky_.add_gradient(draw);
          }};
}

void TrainedScene::learn(TrainProgress& progress, int drawn, BufferView<std::uint32_t> sentinel) {
  const int iteration = progress.iteration;
  // If splats were moved or added, the gradients no longer belong to them, so there is no Adam step
  // (method.md 4.3).
  const bool moved = schedule_.refines(iteration) && refine(iteration);
  if (drawn > 0 && !moved) update(progress, drawn, sentinel);
  if (drawn > 0) sky_.step(*stages_, iteration, schedule_.appearance_rate(iteration, 1), sentinel);
  // This step does not depend on the splats, so it is taken even if splats were moved.
  learn_appearances(progress, sentinel);
  if (const auto done = schedule_.camera_sweep(iteration); done && cameras_.refines()) cameras_.sweep(*done);
}

void TrainedScene::upload_next(int iteration) {
  if (iteration < settings().iterations &&
      views_.factor_at(schedule_.work(), iteration + 1) == views_.factor())
    passes_->upload_first(iteration + 1);
}

bool TrainedScene::refine(int iteration) {
  const auto number = static_cast<std::uint64_t>(iteration);
  const auto spread = static_cast<float>(settings().copy_spread);
  const std::uint32_t moved = splats_->relocate(spread, settings().seed, number);
  const std::uint32_t grown = schedule_.grown(splats(), iteration);
  const bool grows = grown > splats();
  if (grows) splats_->grow(grown, spread, settings().seed, number);
  if (settings().noise_lr > 0 && !is_frozen(stages_->config().frozen, "xyz"))
    stages_->add_noise({.splats = splats_->view(),
                        .amount = schedule_.noise(iteration),
                        .seed = settings().seed,
                        .iteration = number,
                        .first = splats_->first()});
  return moved > 0 || grows;
}

void TrainedScene::update(TrainProgress& progress, int views, BufferView<std::uint32_t> sentinel) {
  const int iteration = progress.iteration;
  rates_.upload(schedule_.learning_rates(splats_->model().layout(), iteration));
  const AdamStep step{.splats = splats_->view(),
                      .v_params = splats_->v_params(),
                      .moment1 = splats_->moment1(),
                      .moment2 = splats_->moment2(),
                      .learning_rates = rates_.view(),
                      .step = ++progress.adam_steps,
                      .sentinel = sentinel,
                      .stamp = static_cast<std::uint32_t>(iteration)};
  // If there are more ranks than blocks of splats, this rank may have no splats.
  if (step.splats.count == 0) return;
  if (!schedule_.refines(iteration))
    return passes_->learning_renderer().learn(views > 1, penalty(iteration), step);
  if (schedule_.regularises(iteration)) stages_->regularise(penalty(iteration));
  stages_->adam(step);
}

Regularise TrainedScene::penalty(int iteration) const {
  Regularise penalty{.splats = splats_->view(), .v_params = splats_->v_params(), .total = splats_->total()};
  if (schedule_.regularises(iteration)) penalty.weights = penalty_weights(settings());
  return penalty;
}

void TrainedScene::learn_appearances(const TrainProgress& progress, BufferView<std::uint32_t> sentinel) {
  passes_->merge(views_.appearance_gradients(), kAppearanceNumbers);
  const std::uint64_t first = views_.first_draw(progress.iteration);
  const double rate = schedule_.appearance_rate(progress.iteration, views_.images());
  for (std::uint64_t draw = first; draw < first + views_.batch(); ++draw)
    if (!progress.skipped_draws.contains(draw))
      views_.learn_appearance(*stages_, draw, rate, sentinel, static_cast<std::uint32_t>(progress.iteration));
}

// ---- Measurements ----

std::vector<DrawLoss> TrainedScene::losses(const TrainProgress& progress) const {
  const int iterations = std::min(progress.iteration - progress.logged, settings().log_every);
  passes_->merge(losses_.view(), 8);
  const std::vector<float> sums = losses_.download();
  const std::uint64_t end = views_.first_draw(progress.iteration + 1);
  std::vector<DrawLoss> losses;
  for (std::uint64_t draw = end - static_cast<std::uint64_t>(iterations) * views_.batch(); draw < end; ++draw)
    if (!progress.skipped_draws.contains(draw)) losses.push_back({draw, losses_.loss(sums, draw)});
  return losses;
}

Metrics TrainedScene::evaluate_test(ImageMetrics* more, bool last) {
  stages_->pause();
  Metrics metrics = passes_->evaluate_test(more, settings().appearance);
  if (cameras_.refines() && last) cameras_.measure_fitted(metrics);
  return metrics;
}

Metrics TrainedScene::evaluate_train(std::size_t most) {
  stages_->pause();
  if (views_.use_factor(1)) set_cameras(views_.cameras());
  Metrics metrics;
  const std::size_t all = views_.train().views.size(), count = std::min(most, all);
  for (std::size_t k = 0; k < count; ++k) {
    const auto view = static_cast<std::uint32_t>((2 * k + 1) * all / (2 * count));
    const Target target = views_.targets().get(view);
    if (target.mask.size > 0 && target.counted == 0) continue;
    metrics.views.push_back(passes_->evaluate_train(view, settings().appearance));
  }
  add_mean(metrics);
  return metrics;
}

// ---- The state ----

void TrainedScene::save(TrainState& state, bool everywhere) const {
  splats_->save(state, everywhere);
  passes_->merge(losses_.view(), 8);
  state.loss_sums = losses_.download();
  if (state.iteration == 0) std::ranges::fill(state.loss_sums, 0.0f);  // nothing has been written yet
  state.appearance = views_.appearance();
  state.sky = sky_.state();
  if (views_.refiner()) state.cameras = views_.refiner()->state();
}

void TrainedScene::load(const TrainState& state) {
  splats_->load(state);
  losses_.load(state.loss_sums);
  views_.set_appearance(state.appearance);
  sky_.load(state.sky);
  views_.set_refined(state.cameras);
  if (cameras_.refines()) set_cameras(views_.cameras());
  cameras_.forget();
}

}  // namespace ubs
