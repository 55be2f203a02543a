// SPDX-License-Identifier: Apache-2.0
#include "host/train/trainer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "host/base/error.hpp"
#include "host/device/operations.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/train/nonfinite_source.hpp"
#include "host/train/shared_splats.hpp"

namespace ubs {
namespace {

// Returns the settings for a run that starts from this model. Automatic values are resolved, and cap_max is
// increased to the number of splats of the model if it is smaller.
TrainSettings settings_for(TrainSettings settings, const SplatModel& initial, const Communicator& ranks) {
  check_initial(settings, initial);
  if (ranks.size() > 1 && settings.refine_cameras != RefineCameras::none)
    fail(ErrorKind::usage, "refine_cameras is not supported with several MPI processes");
  settings = resolve_automatic(std::move(settings));
  settings.cap_max = std::max(settings.cap_max, static_cast<int>(initial.count));
  return settings;
}

// Returns the scene extent. If all cameras have the same position, no length can be computed from them, so
// the extent is 1 unit.
double extent_of(const Split& train) {
  return at_one_place(cameras_of(train)) ? 1 : scene_extent(train.views);
}

// TrainingClock measures the training time. read() updates `seconds`. When go_on() is called, the time since
// the last read() is not counted.
class TrainingClock {
 public:
  TrainingClock(const TimeSource& time, double& seconds)
      : time_(time), seconds_(seconds), before_(seconds), start_(time.seconds()) {}
  void read() { seconds_ = before_ + time_.seconds() - start_; }
  void go_on() {
    before_ = seconds_;
    start_ = time_.seconds();
  }

 private:
  const TimeSource& time_;
  double& seconds_;
  double before_, start_;
};

}  // namespace

Trainer::Trainer(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
                 SplatModel initial, Communicator& ranks, const TimeSource& time)
    : time_(time),
      ranks_(ranks),
      device_(device),
      initial_(static_cast<std::uint32_t>(initial.count)),
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
      losses_(device, this->settings()),
      guard_(device, this->settings().on_nan) {
  if (this->settings().refine_cameras != RefineCameras::none) views_.refine_cameras(initial);
  set_cameras(views_.cameras());
}

TrainSettings Trainer::drawn_settings() const {
  TrainSettings drawn = settings();
  drawn.background = learnt_background(drawn.background, sky_.state());
  return drawn;
}

MemoryPlan Trainer::memory_plan() const {
  MemoryQuestion question =
      memory_question(settings(), views_.train(), views_.test(), device_.info(), splats_->model().stride());
  question.intersections = passes_->renderer().intersection_capacity();
  question.refinement = schedule_.ever_refines_by(progress_.iteration);
  return plan_memory(question);
}

// ---- One iteration ----

void Trainer::step() {
  const int iteration = ++progress_.iteration;
  stages_->begin_iteration(iteration, refines_now());
  int drawn = 0;
  try {
    use_level_of(iteration);
    sky_.clear();
    drawn = passes_->run(views_of_step());
  } catch (...) {  // for example, an image cannot be read; the state has not changed yet
    --progress_.iteration;
    throw;
  }
  whole_ = false;
  // If splats were moved or added, the gradients no longer belong to them, so there is no Adam step
  // (method.md 4.3).
  const bool moved = refines_now() && refine();
  if (drawn > 0 && !moved) update(drawn);
  if (drawn > 0) sky_.step(*stages_, iteration, schedule_.appearance_rate(iteration, 1), guard_.sentinel());
  learn_appearances();  // even if splats were moved, because this step does not depend on the splats
  if (const auto done = schedule_.camera_sweep(iteration); done && cameras_.refines()) cameras_.sweep(*done);
  guard_.stepped(progress_, drawn == 0);
  whole_ = true;
  // The upload runs in parallel with the projection and forward pass of the next iteration. It comes last,
  // because it throws if the image cannot be read.
  if (iteration < settings().iterations &&
      views_.factor_at(schedule_.work(), iteration + 1) == views_.factor())
    passes_->upload_first(iteration + 1);
}

void Trainer::use_level_of(int iteration) {
  if (views_.use_factor(views_.factor_at(schedule_.work(), iteration))) set_cameras(views_.cameras());
}

// Returns the views of this step. For the last view, only the gradient of the records is computed, because
// update() computes the gradient of the parameters together with the Adam step. In iterations that refine,
// the complete gradient is computed.
StepViews Trainer::views_of_step() {
  const std::uint64_t first = views_.first_draw(progress_.iteration);
  return {.first = first,
          .end = first + views_.batch(),
          .left_out = progress_.skipped_draws,
          .uncounted = lists_uncounted(settings(), device_.info()),
          .keeps_records = !refines_now(),
          .loss = [this](std::uint64_t draw) {
            ImageLoss loss = views_.loss(passes_->renderer(), draw, losses_.view());
            loss.sums_offset = static_cast<std::uint32_t>(losses_.offset(draw));
            stages_->image_loss(loss);
            sky_.add_gradient(draw);
          }};
}

bool Trainer::refine() {
  const auto iteration = static_cast<std::uint64_t>(progress_.iteration);
  const std::uint32_t moved = splats_->relocate(settings().seed, iteration);
  if (pace_ && !pace_->serves_more(splats(), settings()) && settings().growth_end == 1) {
    TrainSettings changed = settings();
    changed.growth_end = schedule_.work().at(progress_.iteration);
    schedule_ = schedule_.with(std::move(changed));
  }
  const std::uint32_t grown = schedule_.grown(splats(), progress_.iteration);
  const bool grows = grown > splats();
  if (grows) splats_->grow(grown, settings().seed, iteration);
  if (settings().noise_lr > 0 && !is_frozen(stages_->config().frozen, "xyz"))
    stages_->add_noise({.splats = splats_->view(),
                        .amount = schedule_.noise(progress_.iteration),
                        .seed = settings().seed,
                        .iteration = iteration,
                        .first = splats_->first()});
  return moved > 0 || grows;
}

void Trainer::update(int views) {
  const AdamStep step = next_step();
  // There are more ranks than blocks of splats, so this rank has no splats.
  if (step.splats.count == 0) return;
  if (!refines_now()) return passes_->learning_renderer().learn(views > 1, penalty(), step);
  if (schedule_.regularises(progress_.iteration)) stages_->regularise(penalty());
  stages_->adam(step);
}

Regularise Trainer::penalty() const {
  Regularise penalty{.splats = splats_->view(), .v_params = splats_->v_params(), .total = splats_->total()};
  if (!schedule_.regularises(progress_.iteration)) return penalty;
  penalty.weights = penalty_weights(settings());
  return penalty;
}

AdamStep Trainer::next_step() {
  rates_.upload(schedule_.learning_rates(splats_->model().layout(), progress_.iteration));
  return {.splats = splats_->view(),
          .v_params = splats_->v_params(),
          .moment1 = splats_->moment1(),
          .moment2 = splats_->moment2(),
          .learning_rates = rates_.view(),
          .step = ++progress_.adam_steps,
          .sentinel = guard_.sentinel(),
          .stamp = static_cast<std::uint32_t>(progress_.iteration)};
}

void Trainer::learn_appearances() {
  passes_->merge(views_.appearance_gradients(), kAppearanceNumbers);
  const std::uint64_t first = views_.first_draw(progress_.iteration);
  const double rate = schedule_.appearance_rate(progress_.iteration, views_.images());
  for (std::uint64_t draw = first; draw < first + views_.batch(); ++draw)
    if (!progress_.skipped_draws.contains(draw))
      views_.learn_appearance(*stages_, draw, rate, guard_.sentinel(),
                              static_cast<std::uint32_t>(progress_.iteration));
}

// ---- The run ----

void Trainer::run(const std::function<bool(const StepReport&)>& on_step) {
  double evaluated = progress_.seconds;
  if (guard_.wants_state()) guard_.keep(state(true));
  std::optional<TestSample> sample;
  if (samples_ && ranks_.size() == 1) sample.emplace(views_.test().views.size(), pace_.has_value());
  bool go_on = true;
  TrainingClock clock(time_, progress_.seconds);
  while (go_on && progress_.iteration < settings().iterations) {
    step();
    clock.read();
    if (pace_ && at_point()) {
      device_.finish();
      clock.read();
      set_pace();
    }
    const int iteration = progress_.iteration;
    const Due now = due(evaluated);
    // Check the values before anything other than the Adam step changes the state, and before the state is
    // saved or reported.
    if (now.looks && !look()) clock.go_on();
    if (progress_.iteration != iteration) continue;  // an earlier state was restored
    StepReport report{.iteration = iteration,
                      .iterations = settings().iterations,
                      .share = schedule_.work().at(iteration),
                      .splats = splats()};
    if (now.reads) {
      report.loss = read_loss();
      if (progress_.iteration != iteration) {
        clock.go_on();
        continue;
      }
      progress_.logged = iteration;
      device_.finish();
      clock.read();
    }
    report.seconds = progress_.seconds;
    if (pace_) report.seconds_left = pace_->seconds_left(schedule_.work(), iteration);
    if (now.evaluates) {
      report.test = evaluate_test();
      evaluated = progress_.seconds;
    }
    if (sample && now.reads) measure_sample(*sample, report);
    if (report.test || report.sample) clock.go_on();
    // Report the iteration before the state is saved. If the run is killed in between, the resumed run
    // reports this iteration again. In the opposite order, it would not report it at all.
    std::uint64_t stops = on_step(report) ? 0 : 1;  // on any rank
    ranks_.sum(std::span(&stops, 1));
    go_on = stops == 0;
    if (now.saves && go_on) {
      save_state();
      clock.go_on();
    }
    if (now.completes && go_on) {
      complete(*completes_in_);
      completes_in_.reset();
      completed_from_ = progress_;
    }
  }
  look();
}

// Returns the actions that must follow now. `evaluated` is the training time at the last evaluation.
Trainer::Due Trainer::due(double evaluated) const {
  const int iteration = progress_.iteration;
  const bool last = iteration == settings().iterations;
  const RunInterval every = evaluation_interval(settings());
  const bool completes = !last && completes_in_;
  std::array decisions{every.seconds > 0 && std::floor(progress_.seconds / every.seconds) >
                                                std::floor(evaluated / every.seconds),
                       !last && (save_due() || (completes && saving_.save))};
  passes_->agree(decisions, guard_.sentinel(), iteration);
  const auto [by_time, saves] = decisions;
  const bool by_iteration = every.iterations > 0 && iteration % every.iterations == 0;
  const bool evaluates = !views_.test().views.empty() && (last || by_time || by_iteration);
  const bool reads = evaluates || last || completes || iteration - progress_.logged >= settings().log_every;
  const bool changes =
      schedule_.refines(iteration + 1) || (cameras_.refines() && schedule_.camera_sweep(iteration + 1));
  return {evaluates, saves, completes, reads, guard_.due(iteration, reads || saves || changes)};
}

// Measures a sample of the test views if this is due. If all test views have just been evaluated, the result
// is computed from this evaluation.
void Trainer::measure_sample(TestSample& sample, StepReport& report) {
  if (report.test) {
    if (sample.views().empty()) return;
    SampledPsnr mean{0, sample.views().size()};
    for (const std::uint32_t view : sample.views())
      mean.psnr += report.test->views[view].psnr_channel_mean / static_cast<double>(mean.views);
    report.sample = mean;
    return;
  }
  // The estimate for one test view is the time of a training view, scaled to full size. This is too high,
  // because a training view also has a backward pass.
  const double factor = views_.factor(), views = static_cast<double>(views_.first_draw(report.iteration + 1));
  if (!sample.is_due(report.share, report.seconds, report.seconds * factor * factor / views)) return;
  stages_->pause();
  report.sample = sample.measure([&](std::uint32_t view) { return passes_->test_psnr(view); },
                                 [&] { return time_.seconds(); });
}

// Waits for the device and returns the mean loss of the iterations since the last reported one.
std::optional<double> Trainer::read_loss() {
  const int iterations = std::min(progress_.iteration - progress_.logged, settings().log_every);
  passes_->merge(losses_.view(), 8);
  const std::vector<float> sums = losses_.download();
  const std::uint64_t end = views_.first_draw(progress_.iteration + 1);
  double total = 0;
  std::size_t views = 0;
  for (std::uint64_t draw = end - static_cast<std::uint64_t>(iterations) * views_.batch(); draw < end;
       ++draw) {
    if (progress_.skipped_draws.contains(draw)) continue;
    const double loss = losses_.loss(sums, draw);
    if (!std::isfinite(loss)) {
      loss_not_finite(draw);
      return {};
    }
    total += loss;
    ++views;
  }
  if (views == 0) return {};
  return total / static_cast<double>(views);
}

Metrics Trainer::evaluate_test(ImageMetrics* more) {
  stages_->pause();
  Metrics metrics = passes_->evaluate_test(more, settings().appearance);
  if (cameras_.refines() && progress_.iteration == settings().iterations) cameras_.measure_fitted(metrics);
  return metrics;
}

Metrics Trainer::evaluate_train(std::size_t most) {
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

void Trainer::keep_to(const TimeBudget& budget) {
  if (ranks_.size() > 1) fail(ErrorKind::usage, "a time budget is not supported with several MPI processes");
  const bool begins = progress_.iteration == 0 && settings().work_shares.empty();
  if (begins) progress_.seconds = budget.spent;
  begin_pace(budget);
  // A run that is resumed with another budget starts at the last point, so it needs a new one. In other
  // resumed runs, the last point is after the current iteration, because states are saved after the next
  // point has been set.
  if (begins || at_point()) set_pace(true);
}

void Trainer::begin_pace(TimeBudget budget) {
  if (budget.costs.empty()) {
    use_speed(budget, settings(), views_.train(), progress_, cameras_.swept_seconds());
    if (cameras_.refines())
      for (StepCost& cost : budget.costs) cost.sweep_ms = 1e3 * cameras_.sweep_seconds(cost.factor);
  }
  pace_.emplace(std::move(budget), settings(), views_.train(), initial_);
  pace_->begin(schedule_.work(), progress_.iteration, progress_.seconds, cameras_.swept_seconds());
}

bool Trainer::at_point() const {
  return progress_.iteration == schedule_.work().last().iteration &&
         progress_.iteration < settings().iterations;
}

void Trainer::set_pace(bool any_change) {
  TrainSettings changed = settings();
  pace_->advance(changed, progress_.iteration, progress_.seconds, cameras_.swept_seconds(), any_change);
  schedule_ = schedule_.with(std::move(changed));
}

void Trainer::complete_in(double seconds) {
  if (ranks_.size() > 1) fail(ErrorKind::internal, "a run of several ranks cannot be completed early");
  if (!completed_from_) completes_in_ = seconds;
}

void Trainer::complete(double seconds) {
  if (!pace_) begin_pace({});
  TrainSettings changed = settings();
  pace_->complete(changed, progress_.iteration, progress_.seconds, cameras_.swept_seconds(), seconds,
                  splats());
  schedule_ = schedule_.with(std::move(changed));
}

void Trainer::go_on_for(double seconds) {
  if (!pace_ || progress_.iteration != settings().iterations)
    fail(ErrorKind::internal, "go_on_for() requires a finished run with a time budget");
  complete(seconds);
}

// ---- The state ----

TrainState Trainer::state(bool everywhere) const {
  TrainState s{progress_};
  splats_->save(s, everywhere);
  passes_->merge(losses_.view(), 8);
  s.loss_sums = losses_.download();
  if (s.iteration == 0) std::ranges::fill(s.loss_sums, 0.0f);  // nothing has been written yet
  s.appearance = views_.appearance();
  s.sky = sky_.state();
  if (views_.refiner()) s.cameras = views_.refiner()->state();
  return s;
}

void Trainer::restore(const TrainState& s) {
  splats_->load(s);
  losses_.load(s.loss_sums);
  views_.set_appearance(s.appearance);
  sky_.load(s.sky);
  views_.set_refined(s.cameras);
  if (cameras_.refines()) set_cameras(views_.cameras());
  cameras_.forget();
  progress_ = s;
  saved_seconds_ = s.seconds;
  guard_.restart(s);
  if (pace_) pace_->begin(schedule_.work(), s.iteration, s.seconds, cameras_.swept_seconds());
  whole_ = true;
}

bool Trainer::save_due() const {
  if (!saving_.save || completed_from_) return false;
  return (saving_.iterations > 0 && progress_.iteration % saving_.iterations == 0) ||
         (saving_.seconds > 0 && progress_.seconds - saved_seconds_ >= saving_.seconds);
}

// Saves the state. Relocation, growth or noise may have produced a value that is not finite and that only the
// next step will detect. In this case nothing is saved, and the previously saved state remains.
void Trainer::save_state() {
  saved_seconds_ = progress_.seconds;
  TrainState s = state();
  std::uint64_t bad = is_finite(s) ? 0 : 1;
  ranks_.sum(std::span(&bad, 1));
  if (bad > 0) return;
  saving_.save(s);
  if (settings().on_nan == OnNan::rollback) guard_.keep(ranks_.size() > 1 ? state(true) : std::move(s));
}

bool Trainer::look() {
  if (guard_.look(progress_)) return true;
  TrainState s = state(true);
  NonFiniteEvent event{progress_.iteration, {}, splats_not_finite(s)};
  use_level_of(event.iteration);
  event.source = find_nonfinite_source(device_, *stages_, views_, render_settings(), s);
  answer(event, std::move(s));
  return false;
}

// Handles a loss that is not finite although look() has found that all parameters and moments are finite.
void Trainer::loss_not_finite(std::uint64_t draw) {
  const std::uint32_t view = views_.view_of(draw);
  const int iteration = static_cast<int>(draw / views_.batch()) + 1;
  if (settings().on_nan == OnNan::off)
    fail(ErrorKind::numerical,
         "the loss is not finite at iteration {}, view '{}': try smaller learning rates", iteration,
         views_.train().views[view].name);
  answer({iteration, {"image_loss", view}, {}}, state(true));
}

void Trainer::answer(const NonFiniteEvent& event, TrainState s) {
  whole_ = false;  // if this ends the run, the last valid state is the one that was saved last
  restore(guard_.answer(event, std::move(s), views_));
}

}  // namespace ubs
