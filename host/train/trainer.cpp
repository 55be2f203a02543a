// SPDX-License-Identifier: Apache-2.0
#include "host/train/trainer.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "host/base/error.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/train/nonfinite_source.hpp"

namespace ubs {
namespace {

constexpr std::uint64_t kViewsAhead = 3;  // draws for which images are decoded ahead

// As a run needs them from this model on.
TrainSettings settings_for(TrainSettings settings, const SplatModel& initial) {
  check_initial(settings, initial);
  return resolve_automatic(std::move(settings));
}

std::unique_ptr<TimedStages> training_stages(Device& device, const TrainSettings& settings,
                                             const TimeSource& time) {
  return std::make_unique<TimedStages>(device, make_stages(device, training_config(settings, device.info())),
                                       time);
}

// Adds the training time to `seconds`. The time between the last read() and the next go_on() is not counted.
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

// Rows of `stride` on the device to rows of `count`, and back with zeros in between.
std::vector<float> download_compact(const Buffer<float>& buffer, std::uint32_t stride, std::uint32_t count) {
  const std::size_t rows = buffer.size() / stride;
  std::vector<float> values(rows * count);
  for (std::size_t r = 0; r < rows; ++r)
    buffer.download(std::span(values).subspan(r * count, count), r * stride);
  return values;
}

void upload_compact(Buffer<float>& buffer, std::uint32_t stride, std::uint32_t count,
                    std::span<const float> values) {
  const std::size_t rows = buffer.size() / stride;
  if (values.size() != rows * count)
    fail(ErrorKind::internal, "{} moments of {} splats for {} rows", values.size(), count, rows);
  buffer.zero();
  for (std::size_t r = 0; r < rows; ++r) buffer.upload(values.subspan(r * count, count), r * stride);
}

SplatModel own_part(const SplatModel& model, const Communicator& ranks) {
  if (ranks.size() == 1) return model;
  return part_of(model, share_of(static_cast<std::uint32_t>(model.count), ranks.size(), ranks.rank()));
}

std::size_t own_capacity(int splats, std::size_t initial, const Communicator& ranks) {
  const auto all = static_cast<std::uint32_t>(std::max(static_cast<std::size_t>(splats), initial));
  return ranks.size() == 1 ? all : largest_share(all, ranks.size());
}

}  // namespace

Trainer::Trainer(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
                 SplatModel initial, Communicator& ranks, const TimeSource& time)
    : time_(time),
      ranks_(ranks),
      device_(device),
      settings_(settings_for(settings, initial)),
      initial_(static_cast<std::uint32_t>(initial.count)),
      views_(device, settings_, train, test),
      schedule_(settings_, initial.count, scene_extent(train.views)),
      stages_(training_stages(device, settings_, time)),
      model_(device, own_part(initial, ranks), own_capacity(settings.cap_max, initial.count, ranks)),
      renderer_(device, *stages_),
      guard_(device, settings_.on_nan) {
  settings_.cap_max = std::max(settings_.cap_max, static_cast<int>(initial.count));
  const std::size_t size =
      static_cast<std::size_t>(trained_rows(model_.layout(), stages_->config().frozen)) * model_.stride();
  for (auto [buffer, label] : {std::pair{&learning_.v_params, "parameter gradients"},
                               {&learning_.moment1, "first moments"},
                               {&learning_.moment2, "second moments"}}) {
    *buffer = Buffer<float>(device, label, size);
    buffer->zero();
  }
  learning_.rates = Buffer<float>(device, "learning rates", static_cast<std::size_t>(model_.rows()));
  learning_.loss_sums = Buffer<float>(device, "loss sums", 8 * loss_rows());
  if (ranks.size() > 1)
    sharing_ =
        std::make_unique<Sharing>(SharedRenderer(ranks, device, *stages_, renderer_),
                                  SharedSplats(ranks, device, *stages_, model_, learning_.moment1,
                                               learning_.moment2, static_cast<std::uint32_t>(initial.count)),
                                  Deal(views_.batch(), ranks.size()));
  if (settings_.refine_cameras != RefineCameras::none) {
    if (sharing_) fail(ErrorKind::usage, "refine_cameras needs one process: several ranks cannot share it");
    views_.refine_cameras(initial);
  }
  set_cameras(views_.cameras());
  if (settings_.background.learnt == Background::Learnt::no) return;
  learning_.v_sky = Buffer<float>(device, "sky gradients", views_.batch() * kSkyNumbers);
  renderer_.set_sky(render_settings().sky.value());
}

std::vector<float> Trainer::sky_state() const {
  return learning_.v_sky ? read_values(device_, renderer_.sky(), kSkyState) : std::vector<float>{};
}

TrainSettings Trainer::drawn_settings() const {
  TrainSettings settings = settings_;
  settings.background = learnt_background(settings.background, sky_state());
  return settings;
}

void Trainer::learn_sky() {
  if (!learning_.v_sky) return;
  if (sharing_) merge_by_draw(learning_.v_sky.view(), kSkyNumbers);
  const int iteration = progress_.iteration;
  const auto rate = static_cast<float>(schedule_.appearance_rate(iteration, 1));
  stages_->sky_step({.state = renderer_.sky(),
                     .gradient = learning_.v_sky.view(),
                     .views = static_cast<std::uint32_t>(views_.batch()),
                     .rate = rate,
                     .rate_harmonics = settings_.background.learnt == Background::Learnt::sky ? rate : 0,
                     .step = static_cast<std::uint64_t>(iteration),
                     .sentinel = guard_.sentinel(),
                     .stamp = static_cast<std::uint32_t>(iteration)});
}

void Trainer::set_cameras(const std::vector<Camera>& cameras) {
  renderer_.set_cameras(cameras);
  if (sharing_) sharing_->views.set_cameras(cameras);
}

void Trainer::draw(std::uint32_t camera) {
  if (!sharing_) {
    renderer_.forward(model_.view(), camera, render_settings(), false);
    return;
  }
  std::vector<std::int64_t> cameras(static_cast<std::size_t>(ranks_.size()), kNoView);
  cameras[0] = camera;
  draw_shared(std::move(cameras));
}

void Trainer::use_level_of(int iteration) {
  if (views_.use_factor(views_.factor_at(schedule_.work(), iteration))) set_cameras(views_.cameras());
}

MemoryPlan Trainer::memory_plan() const {
  MemoryQuestion question =
      memory_question(settings_, views_.train(), views_.test(), device_.info(), model_.stride());
  question.intersections = renderer_.intersection_capacity();
  question.refinement = schedule_.ever_refines_by(progress_.iteration);
  return plan_memory(question);
}

std::size_t Trainer::loss_rows() const {
  return static_cast<std::size_t>(settings_.batch) * static_cast<std::size_t>(settings_.log_every);
}

std::vector<float> Trainer::rates() const {
  return schedule_.learning_rates(model_.layout(), progress_.iteration);
}

void Trainer::step() {
  const int iteration = ++progress_.iteration;
  stages_->begin_iteration(iteration, refines_now());
  int views = 0;
  try {
    use_level_of(iteration);
    if (learning_.v_sky) learning_.v_sky.zero();  // of views that are left out
    views = render_views();
  } catch (...) {  // an image that cannot be read, no memory for the lists: nothing has changed yet
    --progress_.iteration;
    throw;
  }
  whole_ = false;
  // Where splats were moved or added their gradients no longer belong to them: no Adam step (method.md 4.3).
  if ((!refines_now() || !refine()) && views > 0) update(views);
  if (views > 0) learn_sky();
  if (sharing_) merge_by_draw(views_.appearance_gradients(), kAppearanceNumbers);
  // Also where splats were moved and take no step: their images have not changed.
  const std::uint64_t first = views_.first_draw(iteration);
  for (std::uint64_t draw = first; draw < first + views_.batch(); ++draw)
    if (!progress_.skipped_draws.contains(draw))
      views_.learn_appearance(*stages_, draw,
                              schedule_.appearance_rate(iteration, views_.train().views.size()),
                              guard_.sentinel(), static_cast<std::uint32_t>(iteration));
  if (const auto done = schedule_.camera_sweep(iteration); done && views_.refiner()) sweep_cameras(*done);
  guard_.stepped(progress_, views == 0);
  whole_ = true;
  // Beside the next iteration's projection and forward pass; last, because an image that cannot be read is an
  // error.
  if (iteration < settings_.iterations &&
      views_.factor_at(schedule_.work(), iteration + 1) == views_.factor())
    upload_first_view(iteration + 1);
}

// Of those that this rank draws.
void Trainer::upload_first_view(int iteration) {
  std::int64_t view = 0;
  if (sharing_) view = sharing_->deal.rounds()[0][static_cast<std::size_t>(ranks_.rank())];
  if (view != kNoView) views_.upload(views_.first_draw(iteration) + static_cast<std::uint64_t>(view));
}

// Nothing has been changed by the gradients yet when it shows that a view had no room for its lists: the
// step's views are drawn again, waiting, and results are the same bits as of a run that always waits.
int Trainer::render_views() {
  if (sharing_) return render_shared_views();
  std::vector<UncountedView> views;
  int drawn = render_views(lists_uncounted(settings_, device_.info()), views);
  if (!std::ranges::all_of(views, &UncountedView::had_room)) {
    views.clear();
    drawn = render_views(false, views);
    ++intersections_.repeated;
  }
  for (UncountedView& view : views) count(view.totals().intersections);
  return drawn;
}

void Trainer::count(std::uint64_t pairs) {
  intersections_.most = std::max(intersections_.most, pairs);
  intersections_.last = pairs;
  intersections_.total += pairs;
  ++intersections_.views;
}

// Of those that are not left out; update() takes its gradient from the projected splats.
std::uint64_t Trainer::last_draw() const {
  const std::uint64_t first = views_.first_draw(progress_.iteration);
  std::uint64_t last = first + views_.batch() - 1;
  while (last > first && progress_.skipped_draws.contains(last)) --last;
  return last;
}

void Trainer::loss_of(std::uint64_t draw) {
  ImageLoss loss = views_.loss(renderer_, draw, learning_.loss_sums.view());
  loss.sums_offset = static_cast<std::uint32_t>(8 * (draw % loss_rows()));
  stages_->image_loss(loss);
  if (learning_.v_sky)
    renderer_.sky_gradient(learning_.v_sky.view(),
                           static_cast<std::uint32_t>(draw % views_.batch()) * kSkyNumbers);
}

int Trainer::render_views(bool uncounted, std::vector<UncountedView>& views) {
  int drawn = 0;
  const std::set<std::uint64_t>& skipped = progress_.skipped_draws;
  const std::uint64_t first = views_.first_draw(progress_.iteration), end = first + views_.batch();
  const std::uint64_t last = last_draw();
  for (std::uint64_t draw = first; draw < end; ++draw) {
    const std::uint32_t view = views_.view_of(draw);
    views_.prefetch(draw + kViewsAhead);
    if (skipped.contains(draw)) continue;
    if (uncounted)
      views.push_back(renderer_.forward_uncounted(model_.view(), view, render_settings()));
    else  // waits in between
      views.emplace_back(renderer_.forward(model_.view(), view, render_settings(), true));
    loss_of(draw);
    if (draw == last && learns_at_once())
      renderer_.backward_to_records();
    else
      renderer_.backward(learning_.v_params.view(), drawn > 0);
    ++drawn;
    if (draw + 1 < end) views_.upload(draw + 1);
  }
  return drawn;
}

std::vector<float> Trainer::loss_sums() const {
  if (sharing_) merge_by_draw(learning_.loss_sums.view(), 8);
  return learning_.loss_sums.download();
}

std::uint32_t Trainer::relocate() {
  const auto iteration = static_cast<std::uint64_t>(progress_.iteration);
  if (sharing_) return sharing_->splats.relocate(settings_.seed, iteration);
  return stages_->relocate({.splats = model_.view(),
                            .moment1 = learning_.moment1.view(),
                            .moment2 = learning_.moment2.view(),
                            .seed = settings_.seed,
                            .iteration = iteration});
}

void Trainer::grow(std::uint32_t target) {
  const auto iteration = static_cast<std::uint64_t>(progress_.iteration);
  if (sharing_) return sharing_->splats.grow(target, settings_.seed, iteration);
  stages_->grow({.splats = model_.view(),
                 .target = target,
                 .moment1 = learning_.moment1.view(),
                 .moment2 = learning_.moment2.view(),
                 .seed = settings_.seed,
                 .iteration = iteration});
  model_.set_count(target);
}

bool Trainer::refine() {
  const std::uint32_t moved = relocate();
  if (pace_ && !pace_->serves_more(splats(), settings_) && settings_.growth_end == 1) {
    settings_.growth_end = schedule_.work().at(progress_.iteration);
    schedule_ = schedule_.with(settings_);
  }
  const std::uint32_t grown = schedule_.grown(splats(), progress_.iteration);
  const bool grows = grown > splats();
  if (grows) grow(grown);
  add_noise();
  return moved > 0 || grows;
}

void Trainer::add_noise() {
  if (settings_.noise_lr > 0 && !is_frozen(stages_->config().frozen, "xyz"))
    stages_->add_noise({.splats = model_.view(),
                        .amount = schedule_.noise(progress_.iteration),
                        .seed = settings_.seed,
                        .iteration = static_cast<std::uint64_t>(progress_.iteration),
                        .first = sharing_ ? sharing_->splats.share().first : 0});
}

void Trainer::update(int views) {
  const AdamStep step = next_step();
  if (model_.count() == 0) return;  // more ranks than blocks of splats
  if (learns_at_once())
    return (sharing_ ? sharing_->views.owner() : renderer_).learn(views > 1, penalty(), step);
  if (schedule_.regularises(progress_.iteration)) stages_->regularise(penalty());
  stages_->adam(step);
}

Regularise Trainer::penalty() {
  Regularise penalty{.splats = model_.view(), .v_params = learning_.v_params.view(), .total = splats()};
  if (!schedule_.regularises(progress_.iteration)) return penalty;
  penalty.opacity = static_cast<float>(settings_.opacity_reg);
  penalty.scale = static_cast<float>(settings_.scale_penalty);
  return penalty;
}

AdamStep Trainer::next_step() {
  learning_.rates.upload(rates());
  return {.splats = model_.view(),
          .v_params = learning_.v_params.view(),
          .moment1 = learning_.moment1.view(),
          .moment2 = learning_.moment2.view(),
          .learning_rates = learning_.rates.view(),
          .step = ++progress_.adam_steps,
          .sentinel = guard_.sentinel(),
          .stamp = static_cast<std::uint32_t>(progress_.iteration)};
}

double Trainer::loss_of_draw(const std::vector<float>& sums, std::uint64_t draw) const {
  const float* row = &sums[8 * (draw % loss_rows())];
  return (1 - settings_.lambda_dssim) * row[0] + settings_.lambda_dssim * (1 - row[1]);
}

std::optional<double> Trainer::read_loss(int iterations) {
  const std::vector<float> sums = loss_sums();
  const std::uint64_t end = views_.first_draw(progress_.iteration + 1);
  double total = 0;
  std::size_t views = 0;
  for (std::uint64_t draw = end - static_cast<std::uint64_t>(iterations) * views_.batch(); draw < end;
       ++draw) {
    if (progress_.skipped_draws.contains(draw)) continue;
    const double loss = loss_of_draw(sums, draw);
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
  const auto first = static_cast<std::uint32_t>(views_.train().views.size());
  const std::vector<View>& views = views_.test().views;
  if (!sharing_) {
    Metrics metrics = evaluate(device_, *stages_, renderer_, model_.view(), render_settings(), views,
                               views_.targets(), first, more, settings_.appearance);
    if (views_.refiner() && progress_.iteration == settings_.iterations) measure_fitted(metrics);
    return metrics;
  }
  const auto draw = [&](std::size_t own) {
    std::vector<std::int64_t> cameras(static_cast<std::size_t>(ranks_.size()), kNoView);
    const std::size_t round = own - static_cast<std::size_t>(ranks_.rank());
    for (std::size_t r = 0; r < cameras.size() && round + r < views.size(); ++r)
      cameras[r] = static_cast<std::int64_t>(first + round + r);
    draw_shared(std::move(cameras));
  };
  return evaluate(device_, *stages_, renderer_, draw, ranks_, views, views_.targets(), first, more,
                  settings_.appearance);
}

void Trainer::measure_fitted(Metrics& metrics) {
  const RenderGroup group{stages_.get(), model_.view()};
  std::vector<Camera> cameras;
  for (const FittedCamera& fitted : held_out_cameras()) cameras.push_back(fitted.camera);
  measure_from(device_, *stages_, renderer_, std::span(&group, 1), render_settings(), cameras,
               views_.targets(), static_cast<std::uint32_t>(views_.train().views.size()), metrics);
  set_cameras(views_.cameras());
}

void Trainer::sweep_cameras(double done) {
  stages_->pause();
  const RenderGroup group{stages_.get(), model_.view()};
  const double start = time_.seconds();
  views_.sweep_cameras({renderer_, std::span(&group, 1), render_settings()}, done);
  swept_ += time_.seconds() - start;
  set_cameras(views_.cameras());
}

double Trainer::sweep_seconds(int factor) {
  stages_->pause();
  const RenderGroup group{stages_.get(), model_.view()};
  const double seconds =
      views_.refiner()->sweep_seconds({renderer_, std::span(&group, 1), render_settings()}, factor);
  set_cameras(views_.cameras());
  return seconds;
}

std::vector<FittedCamera> Trainer::fit_cameras(const Split& split, std::size_t first, bool fits) {
  stages_->pause();
  const RenderGroup group{stages_.get(), model_.view()};
  const Drawing drawing{renderer_, std::span(&group, 1), render_settings()};
  const SplatModel model = model_.download();
  const std::vector<Camera> cameras = views_.cameras();
  std::vector<FittedCamera> out;
  for (std::size_t i = 0; i < split.views.size(); ++i) {
    const Camera& camera = cameras[first + i];
    out.push_back(fit_camera(drawing, split.views[i].load_image(), camera, pivot_depth(camera, model), fits));
  }
  set_cameras(cameras);
  return out;
}

const std::vector<FittedCamera>& Trainer::held_out_cameras() {
  if (held_out_.empty()) held_out_ = fit_cameras(views_.test(), views_.train().views.size(), true);
  return held_out_;
}

std::vector<FittedCamera> Trainer::refined_cameras() { return fit_cameras(views_.train(), 0, false); }

void Trainer::run(const std::function<bool(const StepReport&)>& on_step) {
  const RunInterval evaluation = evaluation_interval(settings_);
  double evaluated = progress_.seconds;
  if (guard_.wants_state()) guard_.keep(state(true));
  bool go_on = true;
  TrainingClock clock(time_, progress_.seconds);
  while (go_on && progress_.iteration < settings_.iterations) {
    step();
    clock.read();
    if (pace_ && at_point()) {
      device_.finish();
      clock.read();
      set_pace();
    }
    const int iteration = progress_.iteration;
    const bool last = iteration == settings_.iterations;
    bool by_time = evaluation.seconds > 0 && std::floor(progress_.seconds / evaluation.seconds) >
                                                 std::floor(evaluated / evaluation.seconds);
    bool saves = !last && save_due();
    agree(by_time, saves);
    const bool evaluates =
        !views_.test().views.empty() &&
        (last || by_time || (evaluation.iterations > 0 && iteration % evaluation.iterations == 0));
    const bool reads = evaluates || last || iteration - progress_.logged >= settings_.log_every;
    // Before anything but Adam changes the state, and before anyone sees it.
    const bool changes =
        schedule_.refines(iteration + 1) || (views_.refiner() && schedule_.camera_sweep(iteration + 1));
    if (guard_.due(iteration, reads || saves || changes) && !look()) clock.go_on();
    if (progress_.iteration != iteration) continue;  // goes on from an earlier state
    StepReport report;
    report.iteration = iteration;
    report.iterations = settings_.iterations;
    report.share = schedule_.work().at(iteration);
    report.splats = splats();
    if (reads) {
      report.loss = read_loss(std::min(iteration - progress_.logged, settings_.log_every));
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
    if (evaluates) {
      report.test = evaluate_test();
      evaluated = progress_.seconds;
      clock.go_on();
    }
    // Before the state is kept: a run that is killed in between logs this iteration again, none is missing.
    go_on = on_step(report);
    if (sharing_) go_on = ranks_.of_first(go_on) != 0;
    if (saves && go_on) {
      save_state();
      clock.go_on();
    }
  }
  look();
}

void Trainer::keep_to(const TimeBudget& budget) {
  if (sharing_) fail(ErrorKind::usage, "a time budget needs one process: several ranks cannot share it");
  pace_.emplace(budget, settings_, views_.train(), initial_);
  const bool begins = progress_.iteration == 0 && settings_.work_shares.empty();
  if (begins) progress_.seconds = budget.measured;
  pace_->begin(schedule_.work(), progress_.iteration, progress_.seconds, swept_);
  if (begins) set_pace();
}

bool Trainer::at_point() const {
  return progress_.iteration == schedule_.work().last().iteration &&
         progress_.iteration < settings_.iterations;
}

void Trainer::set_pace() {
  pace_->advance(settings_, progress_.iteration, progress_.seconds, swept_);
  schedule_ = schedule_.with(settings_);
}

SplatModel Trainer::model() const {
  if (!sharing_) return model_.download();
  SplatModel all(model_.dim(), 0, model_.layout().variant);
  all.values = sharing_->splats.gather(model_.params(), false);
  if (ranks_.first()) all.count = splats();
  return all;
}

TrainState Trainer::state(bool everywhere) const {
  TrainState s{progress_};
  if (sharing_ && everywhere) {
    const SharedSplats& parts = sharing_->splats;
    s.model = SplatModel(model_.dim(), 0, model_.layout().variant);
    s.model.values = parts.gather(model_.params(), true);
    s.moment1 = parts.gather(learning_.moment1, true);
    s.moment2 = parts.gather(learning_.moment2, true);
    s.model.count = splats();
  } else {
    s.model = model_.download();
    s.moment1 = download_compact(learning_.moment1, model_.stride(), model_.count());
    s.moment2 = download_compact(learning_.moment2, model_.stride(), model_.count());
  }
  s.loss_sums = loss_sums();
  if (s.iteration == 0) std::ranges::fill(s.loss_sums, 0.0f);  // nothing has been written yet
  s.appearance = views_.appearance();
  s.sky = sky_state();
  if (views_.refiner()) s.cameras = views_.refiner()->state();
  return s;
}

void Trainer::restore(const TrainState& s) {
  model_.upload(own_part(s.model, ranks_));
  const auto all = static_cast<std::uint32_t>(s.model.count);
  const Share own = share_of(all, ranks_.size(), ranks_.rank());
  for (auto [buffer, rows] : {std::pair{&learning_.moment1, &s.moment1}, {&learning_.moment2, &s.moment2}})
    upload_compact(*buffer, model_.stride(), model_.count(), sharing_ ? part_of(*rows, all, own) : *rows);
  if (sharing_) sharing_->splats.set_total(all);
  if (s.loss_sums.size() != learning_.loss_sums.size())
    fail(ErrorKind::internal, "{} loss sums for {}", s.loss_sums.size(), learning_.loss_sums.size());
  learning_.loss_sums.upload(s.loss_sums);
  views_.set_appearance(s.appearance);
  if (s.sky.size() != (learning_.v_sky ? kSkyState : 0))
    fail(ErrorKind::internal, "{} numbers of a learnt background", s.sky.size());
  if (learning_.v_sky) renderer_.set_sky(render_settings().sky.value(), s.sky);
  views_.set_refined(s.cameras);
  if (views_.refiner()) set_cameras(views_.cameras());
  progress_ = s;
  saved_seconds_ = s.seconds;
  guard_.restart(s);
  if (pace_) pace_->begin(schedule_.work(), s.iteration, s.seconds, swept_);
  held_out_.clear();
  whole_ = true;
}

bool Trainer::save_due() const {
  return saving_.save && ((saving_.iterations > 0 && progress_.iteration % saving_.iterations == 0) ||
                          (saving_.seconds > 0 && progress_.seconds - saved_seconds_ >= saving_.seconds));
}

// Relocation, growth or noise may have left a value that the next step will notice: then the last state
// stays.
void Trainer::save_state() {
  saved_seconds_ = progress_.seconds;
  TrainState s = state();
  std::uint64_t bad = is_finite(s) ? 0 : 1;
  ranks_.sum(std::span(&bad, 1));
  if (bad > 0) return;
  saving_.save(s);
  if (settings_.on_nan == OnNan::rollback) guard_.keep(sharing_ ? state(true) : std::move(s));
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

// The loss alone: look() has found parameters and moments finite.
void Trainer::loss_not_finite(std::uint64_t draw) {
  const std::uint32_t view = views_.view_of(draw);
  const int iteration = static_cast<int>(draw / views_.batch()) + 1;
  if (settings_.on_nan == OnNan::off)
    fail(ErrorKind::numerical,
         "the loss is not finite at iteration {}, view '{}'; try smaller learning rates", iteration,
         views_.train().views[view].name);
  answer({iteration, {"image_loss", view}, {}}, state(true));
}

void Trainer::answer(const NonFiniteEvent& event, TrainState s) {
  whole_ = false;  // where this ends the run, the last good state is the one handed out last
  restore(guard_.answer(event, std::move(s), views_));
}

}  // namespace ubs
