// SPDX-License-Identifier: Apache-2.0
#include "host/train/trainer.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>

#include "host/base/error.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/train/run_settings.hpp"

namespace ubs {
namespace {

constexpr int kScheduleLength = 30000;  // iterations to which the schedule's numbers refer
constexpr std::size_t kTargetBudgetBytes = std::size_t{1} << 30;
constexpr std::uint64_t kViewsAhead = 3;  // draws for which images are decoded ahead

class StopWatch {
 public:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

 private:
  using Clock = std::chrono::steady_clock;
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
      stages_(make_stages(device, training_config(settings, frozen_, device.info()))),
      model_(device, initial, static_cast<std::size_t>(settings.cap_max)),
      renderer_(device, *stages_),
      render_(ubs::render_settings(settings)),
      targets_(device, kTargetBudgetBytes, static_cast<std::size_t>(settings.image_cache_mb) << 20),
      order_(settings.seed, static_cast<std::uint32_t>(train.views.size())),
      ahead_(order_) {
  if (train.views.empty()) fail(ErrorKind::data, "there are no training views");
  if (initial.dim != settings.dim)
    fail(ErrorKind::usage, "the initial model has {} dimensions, the settings {}", initial.dim, settings.dim);
  if (initial.variant != model_variant(settings))
    fail(ErrorKind::usage, "the initial model is of the form '{}', the settings say '{}'", to_string(initial.variant),
         to_string(model_variant(settings)));
  settings_.cap_max = std::max(settings_.cap_max, static_cast<int>(initial.count));
  if (settings_.noise_lr == kAuto) settings_.noise_lr = has_time(settings_.dim) ? 1.0 : 1e6;

  std::vector<Camera> cameras = cameras_of(train);
  for (const View& view : test.views) cameras.push_back(view.camera);
  renderer_.set_cameras(cameras);
  targets_.add(train);
  targets_.add(test);

  const std::size_t size = static_cast<std::size_t>(trained_rows(model_.layout(), frozen_)) * model_.stride();
  for (auto [buffer, label] : {std::pair{&v_params_, "parameter gradients"}, {&moment1_, "first moments"},
                               {&moment2_, "second moments"}}) {
    *buffer = Buffer<float>(device, label, size);
    buffer->zero();
  }
  learning_rates_ = Buffer<float>(device, "learning rates", static_cast<std::size_t>(model_.rows()));
  loss_sums_ = Buffer<float>(device, "loss sums", 8 * loss_rows());
}

MemoryPlan Trainer::memory_plan() const {
  MemoryQuestion question{.dim = model_.dim(),
                          .trained_rows = trained_rows(model_.layout(), frozen_),
                          .splats = model_.stride(),
                          .intersections = renderer_.intersection_capacity(),
                          .views = train_.views.size() + test_.views.size(),
                          .loss_rows = loss_rows(),
                          .refinement = iteration_ >= scaled(settings_.refine_start),
                          .raster = stages_->config().raster,
                          .compute_units = device_.info().compute_units};
  for (const Split* split : {&train_, &test_})
    for (const View& view : split->views) {
      const Camera& camera = view.camera;
      question.target_bytes += 3ull * static_cast<unsigned>(camera.width) * static_cast<unsigned>(camera.height);
      if (ImageShape{camera.width, camera.height}.plane() > ImageShape{question.width, question.height}.plane()) {
        question.width = camera.width;
        question.height = camera.height;
      }
    }
  question.target_bytes = std::min<std::uint64_t>(question.target_bytes, kTargetBudgetBytes);
  return plan_memory(question);
}

int Trainer::scaled(int iteration) const {
  return static_cast<int>(std::llround(static_cast<double>(iteration) * settings_.iterations / kScheduleLength));
}

bool Trainer::regularised() const {
  return iteration_ > scaled(settings_.refine_start) && iteration_ < scaled(settings_.refine_stop);
}

bool Trainer::refine_now() const {
  return regularised() && iteration_ % std::max(1, scaled(settings_.refine_every)) == 0;
}

double Trainer::lr_xyz() const {
  const double t = static_cast<double>(iteration_) / settings_.iterations;
  return extent_ * std::exp((1 - t) * std::log(settings_.lr_xyz) + t * std::log(settings_.lr_xyz_final));
}

std::size_t Trainer::loss_rows() const {
  return static_cast<std::size_t>(settings_.batch) * static_cast<std::size_t>(settings_.log_every);
}

void Trainer::step() {
  ++iteration_;
  const auto batch = static_cast<std::uint64_t>(settings_.batch);
  for (std::uint64_t b = 0; b < batch; ++b) {
    const std::uint64_t draw = static_cast<std::uint64_t>(iteration_ - 1) * batch + b;
    const std::uint32_t view = order_(draw);
    targets_.prefetch(ahead_(draw + kViewsAhead));
    renderer_.forward(model_.view(), view, render_, true);
    stages_->image_loss({.shape = renderer_.shape(),
                         .image = renderer_.image(),
                         .target = targets_.get(view),
                         .target_float = {},
                         .lambda_dssim = static_cast<float>(settings_.lambda_dssim),
                         .scale = 1.0f / static_cast<float>(settings_.batch),
                         .v_image = renderer_.v_image(),
                         .sums = loss_sums_.view(),
                         .sums_offset = static_cast<std::uint32_t>(8 * (draw % loss_rows()))});
    renderer_.backward(v_params_.view(), b > 0);
  }
  if (regularised())
    stages_->regularise({.splats = model_.view(),
                         .v_params = v_params_.view(),
                         .opacity = static_cast<float>(settings_.opacity_reg),
                         .scale = settings_.scale_reg_mode == "spatial_mean" ? static_cast<float>(settings_.scale_reg)
                                                                             : 0.0f});
  // Where splats were moved or added their gradients no longer belong to them: no Adam step (method.md 4.3).
  if (!refine_now() || !refine()) update();
  if (settings_.noise_when == "every_step") add_noise();
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

void Trainer::update() {
  const std::vector<float> rates = learning_rates();
  learning_rates_.upload(rates);
  stages_->adam({.splats = model_.view(),
                 .v_params = v_params_.view(),
                 .moment1 = moment1_.view(),
                 .moment2 = moment2_.view(),
                 .learning_rates = learning_rates_.view(),
                 .step = ++adam_steps_});
}

std::vector<float> Trainer::learning_rates() const {
  const std::map<std::string, double> by_group{
      {"xyz", lr_xyz()},           {"rgb", settings_.lr_rgb},         {"sh0", settings_.lr_sh0},
      {"sh_rest", settings_.lr_sh_rest}, {"opacity", settings_.lr_opacity}, {"beta", settings_.lr_beta},
      {"mean", settings_.lr_mean}, {"scale", settings_.lr_scale},     {"l_triangle", settings_.lr_l_triangle},
      {"rotation", settings_.lr_rotation}};
  std::vector<float> rates(static_cast<std::size_t>(model_.rows()));
  for (const ParameterGroup& group : parameter_groups(model_.layout()))
    std::fill_n(rates.begin() + group.first, group.count, static_cast<float>(by_group.at(group.name)));
  return rates;
}

double Trainer::read_loss(int iterations) const {
  const std::vector<float> sums = loss_sums_.download();
  const std::size_t rows = static_cast<std::size_t>(iterations) * static_cast<std::size_t>(settings_.batch);
  const std::uint64_t draws = static_cast<std::uint64_t>(iteration_) * static_cast<std::uint64_t>(settings_.batch);
  double total = 0;
  for (std::uint64_t draw = draws - rows; draw < draws; ++draw) {
    const float* row = &sums[8 * (draw % loss_rows())];
    const double loss = (1 - settings_.lambda_dssim) * row[0] + settings_.lambda_dssim * (1 - row[1]);
    if (!std::isfinite(loss)) {
      ViewOrder order(settings_.seed, static_cast<std::uint32_t>(train_.views.size()));
      fail(ErrorKind::numerical, "the loss is not finite at iteration {}, view '{}'; try smaller learning rates",
           draw / static_cast<std::uint64_t>(settings_.batch) + 1, train_.views[order(draw)].name);
    }
    total += loss;
  }
  return total / static_cast<double>(rows);
}

Metrics Trainer::evaluate_test() {
  return evaluate(device_, *stages_, renderer_, model_.view(), render_, test_.views, targets_,
                  static_cast<std::uint32_t>(train_.views.size()));
}

void Trainer::run(const std::function<bool(const StepReport&)>& on_step) {
  std::vector<double> moments = evaluation_seconds(settings_);
  int logged = iteration_;
  bool go_on = true;
  auto watch = std::make_unique<StopWatch>();
  double before = seconds_;
  while (go_on && iteration_ < settings_.iterations) {
    step();
    seconds_ = before + watch->seconds();
    const bool last = iteration_ == settings_.iterations;
    const bool by_time = !moments.empty() && seconds_ >= moments.front();
    const bool evaluates = !test_.views.empty() &&
                           (last || by_time || (settings_.eval_every > 0 && iteration_ % settings_.eval_every == 0));
    StepReport report;
    report.iteration = iteration_;
    report.splats = model_.count();
    if (evaluates || last || iteration_ - logged >= settings_.log_every) {
      report.loss = read_loss(iteration_ - logged);
      logged = iteration_;
      device_.finish();
      seconds_ = before + watch->seconds();
    }
    report.seconds = seconds_;
    if (evaluates) {
      report.test = evaluate_test();
      while (!moments.empty() && seconds_ >= moments.front()) moments.erase(moments.begin());
      before = seconds_;
      watch = std::make_unique<StopWatch>();
    }
    go_on = on_step(report);
  }
}

}  // namespace ubs
