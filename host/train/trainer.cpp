// SPDX-License-Identifier: Apache-2.0
#include "host/train/trainer.hpp"

#include <array>
#include <cmath>
#include <span>

#include "host/base/error.hpp"
#include "host/base/warning.hpp"
#include "host/train/nonfinite_source.hpp"

namespace ubs {
namespace {

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

Trainer::Trainer(Device& device, const Plan& plan, const Split& train, const Split& test,
                 const SplatModel& initial, Communicator& ranks, const TimeSource& time)
    : time_(time),
      plan_(plan),
      device_(device),
      scene_(device, plan.settings(), train, test, initial, ranks, time),
      length_(scene_, progress_, static_cast<std::uint32_t>(initial.count)),
      guard_(device, this->settings().on_nan) {}

Plan Trainer::plan() const {
  Plan now = plan_;
  now.set_length(settings());
  return now;
}

// ---- The run ----

void Trainer::run(const std::function<bool(const StepReport&)>& on_step) {
  double evaluated = progress_.seconds;
  if (guard_.wants_state()) guard_.keep(state(true));
  std::optional<TestSample> sample;
  if (samples_ && scene_.ranks().size() == 1)
    sample.emplace(scene_.views().test().views.size(), length_.adapts());
  bool go_on = true;
  TrainingClock clock(time_, progress_.seconds);
  while (go_on && progress_.iteration < settings().iterations) {
    step();
    clock.read();
    if (length_.change_is_due()) {
      device_.finish();
      clock.read();
      length_.set();
    }
    const int iteration = progress_.iteration;
    const Due now = due(evaluated);
    // Check the values before anything other than the Adam step changes the state, and before the state is
    // saved or reported.
    if (now.looks && !look()) clock.go_on();
    if (progress_.iteration != iteration) continue;  // an earlier state was restored
    StepReport report{.iteration = iteration,
                      .iterations = settings().iterations,
                      .share = scene_.schedule().work().at(iteration),
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
    report.seconds_left = length_.seconds_left();
    if (now.evaluates) {
      report.test = evaluate_test();
      evaluated = progress_.seconds;
    }
    if (sample && now.reads) measure_sample(*sample, report);
    if (report.test || report.sample) clock.go_on();
    // Report the iteration before the state is saved. If the run is killed in between, the resumed run
    // reports this iteration again. In the opposite order, it would not report it at all.
    std::uint64_t stops = on_step(report) ? 0 : 1;  // on any rank
    scene_.ranks().sum(std::span(&stops, 1));
    go_on = stops == 0;
    if (now.saves && go_on) {
      save_state();
      clock.go_on();
    }
    if (now.completes && go_on) {
      length_.complete(*completes_in_);
      completes_in_.reset();
      completed_from_ = progress_;
    }
  }
  look();
}

void Trainer::step() {
  ++progress_.iteration;
  int drawn = 0;
  try {
    drawn = scene_.differentiate(progress_);
  } catch (...) {  // the state has not changed yet
    --progress_.iteration;
    throw;
  }
  whole_ = false;
  if (scene_.schedule().refines(progress_.iteration)) length_.limit_growth();
  scene_.learn(progress_, drawn, guard_.sentinel());
  guard_.stepped(progress_, drawn == 0);
  whole_ = true;
  scene_.upload_next(progress_.iteration);
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
  scene_.agree(decisions, guard_.sentinel(), iteration);
  const auto [by_time, saves] = decisions;
  const bool by_iteration = every.iterations > 0 && iteration % every.iterations == 0;
  const bool evaluates = !scene_.views().test().views.empty() && (last || by_time || by_iteration);
  const bool reads = evaluates || last || completes || iteration - progress_.logged >= settings().log_every;
  const bool changes = scene_.schedule().refines(iteration + 1) ||
                       (scene_.cameras().refines() && scene_.schedule().camera_sweep(iteration + 1));
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
  const double factor = scene_.views().factor(),
               views = static_cast<double>(scene_.views().first_draw(report.iteration + 1));
  if (!sample.is_due(report.share, report.seconds, report.seconds * factor * factor / views)) return;
  scene_.stages().pause();
  report.sample = sample.measure([&](std::uint32_t view) { return scene_.test_psnr(view); },
                                 [&] { return time_.seconds(); });
}

// Waits for the device and returns the mean loss of the iterations since the last reported one.
std::optional<double> Trainer::read_loss() {
  const std::vector<DrawLoss> losses = scene_.losses(progress_);
  double total = 0;
  for (const auto& [draw, loss] : losses) {
    if (!std::isfinite(loss)) {
      loss_not_finite(draw);
      return {};
    }
    total += loss;
  }
  if (losses.empty()) return {};
  return total / static_cast<double>(losses.size());
}

// ---- The length of the run ----

void Trainer::keep_to(const TimeBudget& budget) {
  if (scene_.ranks().size() > 1)
    fail(ErrorKind::usage, "a time budget is not supported with several MPI processes");
  length_.keep_to(budget);
}

void Trainer::complete_in(double seconds) {
  if (scene_.ranks().size() > 1)
    fail(ErrorKind::internal, "a run of several ranks cannot be completed early");
  if (!completed_from_) completes_in_ = seconds;
}

void Trainer::go_on_for(double seconds) {
  if (!length_.adapts() || !is_finished())
    fail(ErrorKind::internal, "go_on_for() requires a finished run with a time budget");
  length_.complete(seconds);
}

// ---- The state ----

TrainState Trainer::state(bool everywhere) const {
  TrainState s{progress_};
  scene_.save(s, everywhere);
  return s;
}

void Trainer::restore(const TrainState& s) {
  scene_.load(s);
  progress_ = s;
  saved_seconds_ = s.seconds;
  guard_.restart(s);
  length_.restart();
  whole_ = true;
}

bool Trainer::save_due() const {
  if (!saving_.save || completed_from_) return false;
  return (saving_.iterations > 0 && progress_.iteration % saving_.iterations == 0) ||
         (saving_.seconds > 0 && progress_.seconds - saved_seconds_ >= saving_.seconds);
}

// Saves the state. Relocation, growth or noise may have produced a value that is not finite and that only the
// next step will detect. In this case nothing is saved, and the previously saved state remains. The same
// holds if the host has no memory for a copy of the state, because training does not need the copy.
void Trainer::save_state() {
  saved_seconds_ = progress_.seconds;
  TrainState s;
  try {
    s = state();
  } catch (const std::bad_alloc&) {
    if (scene_.ranks().size() > 1) throw;  // other ranks wait for this one
    warn("the state at iteration {} is not saved: out of memory", progress_.iteration);
    return;
  }
  std::uint64_t bad = is_finite(s) ? 0 : 1;
  scene_.ranks().sum(std::span(&bad, 1));
  if (bad > 0) return;
  saving_.save(s);
  if (settings().on_nan == OnNan::rollback)
    guard_.keep(scene_.ranks().size() > 1 ? state(true) : std::move(s));
}

// ---- Values that are not finite ----

bool Trainer::look() {
  if (guard_.look(progress_)) return true;
  TrainState s = state(true);
  NonFiniteEvent event{progress_.iteration, {}, splats_not_finite(s)};
  scene_.use_level_of(event.iteration);
  event.source = find_nonfinite_source(device_, scene_.stages(), scene_.views(), scene_.render_settings(), s);
  answer(event, std::move(s));
  return false;
}

// Handles a loss that is not finite although look() has found that all parameters and moments are finite.
void Trainer::loss_not_finite(std::uint64_t draw) {
  const std::uint32_t view = scene_.views().view_of(draw);
  const int iteration = static_cast<int>(draw / scene_.views().batch()) + 1;
  if (settings().on_nan == OnNan::off)
    fail(ErrorKind::numerical,
         "the loss is not finite at iteration {}, view '{}': try smaller learning rates", iteration,
         scene_.views().train().views[view].name);
  answer({iteration, {"image_loss", view}, {}}, state(true));
}

void Trainer::answer(const NonFiniteEvent& event, TrainState s) {
  whole_ = false;  // if this ends the run, the last valid state is the one that was saved last
  restore(guard_.answer(event, std::move(s), scene_.views()));
}

}  // namespace ubs
