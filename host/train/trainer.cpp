// SPDX-License-Identifier: Apache-2.0
#include "host/train/trainer.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/train/plan.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/target_loss.hpp"

namespace ubs {
namespace {

constexpr double kRateOfMixing = 0.2;     // of mixed channels and offsets, of which four act on each channel
constexpr std::uint64_t kViewsAhead = 3;  // draws for which images are decoded ahead

class StopWatch {
 public:
  double seconds() const { return seconds_since(start_); }

 private:
  Clock::time_point start_ = Clock::now();
};

KernelConfig training_config(const TrainSettings& settings, std::uint32_t frozen, const DeviceInfo& device) {
  KernelConfig config = kernel_config(settings.dim, model_variant(settings), settings, device);
  config.frozen = frozen;
  return config;
}

}  // namespace

Trainer::Trainer(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
                 SplatModel initial)
    : device_(device),
      settings_(settings),
      train_(train),
      test_(test),
      extent_(scene_extent(train.views)),
      frozen_(frozen_groups(ParameterLayout(settings.dim, model_variant(settings)), settings.freeze)),
      uncounted_(lists_uncounted(settings, device.info())),
      levels_(pyramid_levels(settings, train)),
      stages_(std::make_unique<TimedStages>(
          device, make_stages(device, training_config(settings, frozen_, device.info())))),
      model_(device, initial, static_cast<std::size_t>(settings.cap_max)),
      renderer_(device, *stages_),
      render_(ubs::render_settings(settings)),
      targets_(device, kTargetBudgetBytes, static_cast<std::size_t>(settings.image_cache_mb) << 20),
      order_(settings.seed, static_cast<std::uint32_t>(train.views.size())),
      ahead_(order_),
      on_nan_(on_nan_from(settings.on_nan)) {
  if (train.views.empty()) fail(ErrorKind::data, "there are no training views");
  if (initial.dim != settings.dim)
    fail(ErrorKind::usage, "the initial model has {} dimensions, the settings {}", initial.dim, settings.dim);
  if (initial.variant != model_variant(settings))
    fail(ErrorKind::usage, "the initial model is of the form '{}', the settings say '{}'",
         to_string(initial.variant), to_string(model_variant(settings)));
  settings_.cap_max = std::max(settings_.cap_max, static_cast<int>(initial.count));
  settings_ = resolve_automatic(settings_);

  targets_.add(train);
  targets_.add(test);
  set_cameras();

  const std::size_t size = static_cast<std::size_t>(trained_rows(model_.layout(), frozen_)) * model_.stride();
  for (auto [buffer, label] : {std::pair{&v_params_, "parameter gradients"},
                               {&moment1_, "first moments"},
                               {&moment2_, "second moments"}}) {
    *buffer = Buffer<float>(device, label, size);
    buffer->zero();
  }
  learning_rates_ = Buffer<float>(device, "learning rates", static_cast<std::size_t>(model_.rows()));
  loss_sums_ = Buffer<float>(device, "loss sums", 8 * loss_rows());
  if (settings_.appearance != "none") {
    appearance_ = Buffer<float>(device, "appearance", train.views.size() * kAppearanceState);
    appearance_.zero();
    v_appearance_ = Buffer<float>(device, "appearance gradients",
                                  static_cast<std::size_t>(settings_.batch) * kAppearanceNumbers);
  }
  if (on_nan_ != OnNan::off) {
    sentinel_ = Buffer<std::uint32_t>(device, "sentinel", 1);
    sentinel_.zero();
  }
}

// Those of the training views at the size that they are trained at now.
void Trainer::set_cameras() {
  std::vector<Camera> cameras;
  for (const View& view : train_.views) cameras.push_back(reduced(view.camera, factor_));
  for (const View& view : test_.views) cameras.push_back(view.camera);
  renderer_.set_cameras(cameras);
}

void Trainer::use_level_of(int iteration) {
  const int factor = level_at(levels_, iteration).factor;
  if (factor == factor_) return;
  targets_.reduce(train_.views.size(), factor);
  factor_ = factor;
  set_cameras();
}

MemoryPlan Trainer::memory_plan() const {
  MemoryQuestion question = memory_question(settings_, train_, test_, device_.info(), model_.stride());
  question.intersections = renderer_.intersection_capacity();
  question.refinement =
      settings_.refine_start < settings_.refine_stop && iteration_ >= scaled(settings_.refine_start);
  return plan_memory(question);
}

int Trainer::scaled(int iteration) const {
  return static_cast<int>(
      std::llround(static_cast<double>(iteration) * settings_.iterations / kScheduleLength));
}

bool Trainer::regularised() const {
  return iteration_ > scaled(settings_.refine_start) && iteration_ < scaled(settings_.refine_stop);
}

bool Trainer::refines_at(int iteration) const {
  return iteration > scaled(settings_.refine_start) && iteration < scaled(settings_.refine_stop) &&
         iteration % std::max(1, scaled(settings_.refine_every)) == 0;
}

double Trainer::cooldown() const {
  const double left = 1 - static_cast<double>(iteration_) / settings_.iterations;
  return left < settings_.lr_cooldown ? left / settings_.lr_cooldown : 1;
}

double Trainer::lr_xyz() const {
  const double t = static_cast<double>(iteration_) / settings_.iterations;
  return extent_ * std::exp((1 - t) * std::log(settings_.lr_xyz) + t * std::log(settings_.lr_xyz_final));
}

double Trainer::lr_appearance() const {
  const double t = static_cast<double>(iteration_) / settings_.iterations;
  return cooldown() * settings_.lr_appearance * std::pow(0.01, t);
}

std::size_t Trainer::loss_rows() const {
  return static_cast<std::size_t>(settings_.batch) * static_cast<std::size_t>(settings_.log_every);
}

void Trainer::step() {
  ++iteration_;
  stages_->begin_iteration(iteration_, refine_now());
  int views = 0;
  try {
    use_level_of(iteration_);
    views = render_views();
  } catch (...) {  // an image that cannot be read, no memory for the lists: nothing has changed yet
    --iteration_;
    throw;
  }
  whole_ = false;
  left_out_ = views == 0;
  // Where splats were moved or added their gradients no longer belong to them: no Adam step (method.md 4.3).
  if ((!refine_now() || !refine()) && views > 0) update(views);
  update_appearance();
  if (settings_.noise_when == "every_step") add_noise();
  adam_history_[static_cast<std::size_t>(iteration_) % adam_history_.size()] = adam_steps_;
  whole_ = true;
  // Beside the next iteration's projection and forward pass; last, because an image that cannot be read is an
  // error.
  if (iteration_ < settings_.iterations && level_at(levels_, iteration_ + 1).factor == factor_)
    targets_.upload(
        ahead_(static_cast<std::uint64_t>(iteration_) * static_cast<std::uint64_t>(settings_.batch)));
}

// Nothing has been changed by the gradients yet when it shows that a view had no room for its lists: the
// step's views are drawn again, waiting, and results are the same bits as of a run that always waits.
int Trainer::render_views() {
  std::vector<UncountedView> views;
  int drawn = render_views(uncounted_, views);
  if (!std::ranges::all_of(views, &UncountedView::had_room)) {
    views.clear();
    drawn = render_views(false, views);
    ++intersections_.repeated;
  }
  for (UncountedView& view : views) {
    const std::uint64_t pairs = view.totals().intersections;
    intersections_.most = std::max(intersections_.most, pairs);
    intersections_.last = pairs;
    intersections_.total += pairs;
    ++intersections_.views;
  }
  return drawn;
}

int Trainer::render_views(bool uncounted, std::vector<UncountedView>& views) {
  int drawn = 0;
  const auto batch = static_cast<std::uint64_t>(settings_.batch);
  const std::uint64_t first = static_cast<std::uint64_t>(iteration_ - 1) * batch;
  std::uint64_t last = first + batch - 1;  // update() takes its gradient from the projected splats
  while (last > first && skipped_draws_.contains(last)) --last;
  for (std::uint64_t draw = first; draw < first + batch; ++draw) {
    const std::uint32_t view = order_(draw);
    targets_.prefetch(ahead_(draw + kViewsAhead));
    if (skipped_draws_.contains(draw)) continue;
    if (uncounted)
      views.push_back(renderer_.forward_uncounted(model_.view(), view, render_));
    else  // waits in between
      views.emplace_back(renderer_.forward(model_.view(), view, render_, true));
    ImageLoss loss = loss_of_draw(renderer_, draw, loss_sums_.view());
    loss.sums_offset = static_cast<std::uint32_t>(8 * (draw % loss_rows()));
    stages_->image_loss(loss);
    if (draw == last && learns_at_once())
      renderer_.backward_to_records();
    else
      renderer_.backward(v_params_.view(), drawn > 0);
    ++drawn;
    if (draw + 1 < first + batch) targets_.upload(order_(draw + 1));
  }
  return drawn;
}

// With the image's own exposure and white balance, where they are learnt.
ImageLoss Trainer::loss_of_draw(const Renderer& renderer, std::uint64_t draw, View1<float> sums) {
  const std::uint32_t view = order_(draw);
  ImageLoss loss = training_loss(renderer, targets_.get(view), settings_, sums);
  loss.appearance = appearance_.view();
  loss.appearance_offset = view * kAppearanceState;
  loss.v_appearance = v_appearance_.view();
  loss.v_appearance_offset =
      static_cast<std::uint32_t>(draw % static_cast<std::uint64_t>(settings_.batch)) * kAppearanceNumbers;
  return loss;
}

// Also where splats were moved and take no step: their images have not changed.
void Trainer::update_appearance() {
  if (!appearance_) return;
  const auto batch = static_cast<std::uint64_t>(settings_.batch);
  const double rate = lr_appearance();
  for (std::uint64_t b = 0; b < batch; ++b) {
    const std::uint64_t draw = static_cast<std::uint64_t>(iteration_ - 1) * batch + b;
    if (skipped_draws_.contains(draw)) continue;
    stages_->appearance_step(
        {.state = appearance_.view(),
         .images = static_cast<std::uint32_t>(train_.views.size()),
         .image = order_(draw),
         .gradient = v_appearance_.view(),
         .gradient_offset = static_cast<std::uint32_t>(b) * kAppearanceNumbers,
         .rate_diagonal = static_cast<float>(rate),
         .rate_other = settings_.appearance == "affine" ? static_cast<float>(kRateOfMixing * rate) : 0,
         .sentinel = sentinel_.view(),
         .stamp = static_cast<std::uint32_t>(iteration_)});
  }
}

bool Trainer::refine() {
  const auto iteration = static_cast<std::uint64_t>(iteration_);
  const std::uint32_t moved = stages_->relocate({.splats = model_.view(),
                                                 .moment1 = moment1_.view(),
                                                 .moment2 = moment2_.view(),
                                                 .seed = settings_.seed,
                                                 .iteration = iteration});
  const auto grown = static_cast<std::uint32_t>(std::min<double>(
      settings_.cap_max, std::floor(settings_.growth * static_cast<double>(model_.count()))));
  const bool grows = grown > model_.count();
  if (grows) {
    stages_->grow({.splats = model_.view(),
                   .target = grown,
                   .moment1 = moment1_.view(),
                   .moment2 = moment2_.view(),
                   .seed = settings_.seed,
                   .iteration = iteration});
    model_.set_count(grown);
  }
  if (settings_.noise_when == "events") add_noise();
  return moved > 0 || grows;
}

void Trainer::add_noise() {
  if (settings_.noise_lr > 0 && !is_frozen(frozen_, "xyz"))
    stages_->add_noise({.splats = model_.view(),
                        .amount = static_cast<float>(settings_.noise_lr * lr_xyz()),
                        .seed = settings_.seed,
                        .iteration = static_cast<std::uint64_t>(iteration_)});
}

// Not where noise may come between gradient and step.
bool Trainer::learns_at_once() const { return !refine_now(); }

void Trainer::update(int views) {
  const AdamStep step = next_step();
  if (learns_at_once()) return renderer_.learn(views > 1, penalty(), step);
  if (regularised()) stages_->regularise(penalty());
  stages_->adam(step);
}

Regularise Trainer::penalty() {
  Regularise penalty{.splats = model_.view(), .v_params = v_params_.view()};
  if (!regularised()) return penalty;
  penalty.opacity = static_cast<float>(settings_.opacity_reg);
  if (settings_.scale_reg_mode == "spatial_mean") penalty.scale = static_cast<float>(settings_.scale_reg);
  return penalty;
}

AdamStep Trainer::next_step() {
  const std::vector<float> rates = learning_rates();
  learning_rates_.upload(rates);
  return {.splats = model_.view(),
          .v_params = v_params_.view(),
          .moment1 = moment1_.view(),
          .moment2 = moment2_.view(),
          .learning_rates = learning_rates_.view(),
          .step = ++adam_steps_,
          .sentinel = sentinel_.view(),
          .stamp = static_cast<std::uint32_t>(iteration_)};
}

std::vector<float> Trainer::learning_rates() const {
  const std::map<std::string, double> by_group{{"xyz", lr_xyz()},
                                               {"rgb", settings_.lr_rgb},
                                               {"sh0", settings_.lr_sh0},
                                               {"sh_rest", settings_.lr_sh_rest},
                                               {"lobes", settings_.lr_sh0},
                                               {"opacity", settings_.lr_opacity},
                                               {"beta", settings_.lr_beta},
                                               {"mean", settings_.lr_mean},
                                               {"scale", settings_.lr_scale},
                                               {"l_triangle", settings_.lr_l_triangle},
                                               {"rotation", settings_.lr_rotation}};
  std::vector<float> rates(static_cast<std::size_t>(model_.rows()));
  for (const ParameterGroup& group : parameter_groups(model_.layout()))
    std::fill_n(rates.begin() + group.first, group.count,
                static_cast<float>(cooldown() * by_group.at(group.name)));
  return rates;
}

std::optional<double> Trainer::read_loss(int iterations) {
  const std::vector<float> sums = loss_sums_.download();
  const std::size_t rows = static_cast<std::size_t>(iterations) * static_cast<std::size_t>(settings_.batch);
  const std::uint64_t draws =
      static_cast<std::uint64_t>(iteration_) * static_cast<std::uint64_t>(settings_.batch);
  double total = 0;
  std::size_t views = 0;
  for (std::uint64_t draw = draws - rows; draw < draws; ++draw) {
    if (skipped_draws_.contains(draw)) continue;
    const float* row = &sums[8 * (draw % loss_rows())];
    const double loss = (1 - settings_.lambda_dssim) * row[0] + settings_.lambda_dssim * (1 - row[1]);
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
  return evaluate(device_, *stages_, renderer_, model_.view(), render_, test_.views, targets_,
                  static_cast<std::uint32_t>(train_.views.size()), more,
                  appearance_fit(settings_.appearance));
}

void Trainer::run(const std::function<bool(const StepReport&)>& on_step) {
  std::vector<double> moments = evaluation_seconds(settings_);
  std::erase_if(moments, [&](double moment) { return moment <= seconds_; });
  if (on_nan_ == OnNan::rollback && !good_) good_ = state();
  bool go_on = true;
  auto watch = std::make_unique<StopWatch>();
  double before = seconds_;
  const auto continue_clock = [&] {  // what lies between was not training
    before = seconds_;
    watch = std::make_unique<StopWatch>();
  };
  while (go_on && iteration_ < settings_.iterations) {
    step();
    seconds_ = before + watch->seconds();
    const bool last = iteration_ == settings_.iterations;
    const bool by_time = !moments.empty() && seconds_ >= moments.front();
    const bool evaluates =
        !test_.views.empty() &&
        (last || by_time || (settings_.eval_every > 0 && iteration_ % settings_.eval_every == 0));
    const bool reads = evaluates || last || iteration_ - logged_ >= settings_.log_every;
    const bool saves = !last && save_due();
    const int ended = iteration_;
    if (look_due(reads || saves) && !look()) continue_clock();
    if (iteration_ != ended) continue;  // a value was not finite, and training goes on from an earlier state
    StepReport report;
    report.iteration = iteration_;
    report.splats = model_.count();
    if (reads) {
      report.loss = read_loss(std::min(iteration_ - logged_, settings_.log_every));
      if (iteration_ != ended) {
        continue_clock();
        continue;
      }
      logged_ = iteration_;
      device_.finish();
      seconds_ = before + watch->seconds();
    }
    report.seconds = seconds_;
    if (evaluates) {
      report.test = evaluate_test();
      while (!moments.empty() && seconds_ >= moments.front()) moments.erase(moments.begin());
      continue_clock();
    }
    // Before the state is kept: a run that is killed in between logs this iteration again, none is missing.
    go_on = on_step(report);
    if (saves && go_on) {
      save_state();
      continue_clock();
    }
  }
  look();
}

}  // namespace ubs
