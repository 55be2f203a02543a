// SPDX-License-Identifier: Apache-2.0
#include "host/train/training_views.hpp"

#include <algorithm>
#include <iterator>

#include "host/base/error.hpp"
#include "host/base/philox.hpp"
#include "host/train/target_loss.hpp"

namespace ubs {
namespace {

// Number of the random stream of background colours. It makes them independent of other random numbers with
// the same seed.
constexpr std::uint32_t kBackgroundStream = 0x6261636b;
// Learning rate of the mixing coefficients and offsets of an affine map, relative to that of the gains. It is
// lower because four numbers together determine each channel.
constexpr double kRateOfMixing = 0.2;

}  // namespace

TrainingViews::TrainingViews(Device& device, const TrainSettings& settings, const Split& train,
                             const Split& test)
    : settings_(settings),
      train_(train),
      test_(test),
      batch_(static_cast<std::uint64_t>(settings.batch)),
      levels_(pyramid_levels(settings, train)),
      targets_(device, kTargetBudgetBytes, static_cast<std::size_t>(settings.image_cache_mb) << 20),
      order_(settings.seed, static_cast<std::uint32_t>(train.views.size())),
      ahead_(order_),
      image_of_(train.views.size()) {
  const auto images = views_by_image(train.views);
  images_ = static_cast<std::uint32_t>(images.size());
  for (std::uint32_t i = 0; i < images_; ++i)
    for (const std::uint32_t view : images[i]) image_of_[view] = i;
  if (train.views.empty()) fail(ErrorKind::data, "there are no training views");
  targets_.add(train);
  targets_.add(test);
  if (settings.appearance == Appearance::none) return;
  appearance_ = Buffer<float>(device, "appearance", std::size_t{images_} * kAppearanceState);
  appearance_.zero();
  v_appearance_ = Buffer<float>(device, "appearance gradients", batch_ * kAppearanceNumbers);
}

bool TrainingViews::use_factor(int factor) {
  if (factor == factor_) return false;
  targets_.reduce(train_.views.size(), factor);
  factor_ = factor;
  return true;
}

std::vector<Camera> TrainingViews::cameras() const {
  std::vector<Camera> cameras;
  for (std::uint32_t i = 0; i < train_.views.size(); ++i) cameras.push_back(camera(i));
  std::ranges::copy(test_cameras(), std::back_inserter(cameras));
  return cameras;
}

std::vector<Camera> TrainingViews::test_cameras() const {
  std::vector<Camera> cameras;
  for (const View& view : test_.views)
    cameras.push_back(refiner_ ? refiner_->with_lens(view.camera) : view.camera);
  return cameras;
}

RenderSettings TrainingViews::settings_of(std::uint64_t draw, RenderSettings settings) {
  if (const auto& background = train_.views[order_(draw)].background) {
    settings.background = *background;
    settings.sky.reset();
    return settings;
  }
  if (settings_.random_background != RandomBackground::on) return settings;
  const CounterRandom random(settings_.seed, kBackgroundStream);
  for (std::uint32_t c = 0; c < 3; ++c)
    settings.background[c] = static_cast<float>(0.5 * settings.background[c] + 0.5 * random.uniform(draw, c));
  return settings;
}

ImageLoss TrainingViews::loss(const Renderer& renderer, std::uint64_t draw, BufferView<float> sums) {
  const std::uint32_t view = order_(draw);
  ImageLoss loss = training_loss(renderer, targets_.get(view), settings_, sums);
  loss.appearance = appearance_.view();
  if (appearance_) loss.appearance_offset = image_of_[view] * kAppearanceState;
  loss.v_appearance = v_appearance_.view();
  loss.v_appearance_offset = appearance_slot(draw);
  return loss;
}

void TrainingViews::learn_appearance(Stages& stages, std::uint64_t draw, double rate,
                                     BufferView<std::uint32_t> sentinel, std::uint32_t stamp) {
  if (!appearance_) return;
  const bool mixes = settings_.appearance == Appearance::affine;
  stages.appearance_step({.state = appearance_.view(),
                          .images = images_,
                          .image = image_of_[order_(draw)],
                          .gradient = v_appearance_.view(),
                          .gradient_offset = appearance_slot(draw),
                          .rate_diagonal = static_cast<float>(rate),
                          .rate_other = mixes ? static_cast<float>(kRateOfMixing * rate) : 0,
                          .sentinel = sentinel,
                          .stamp = stamp});
}

std::vector<float> TrainingViews::appearance() const {
  return appearance_ ? appearance_.download() : std::vector<float>{};
}

void TrainingViews::set_appearance(std::span<const float> values) {
  if (values.size() != appearance_.size())
    fail(ErrorKind::internal, "the state of the appearance has {} numbers instead of {}", values.size(),
         appearance_.size());
  if (appearance_) appearance_.upload(values);
}

void TrainingViews::set_refined(std::span<const double> state) {
  if (refiner_.has_value() == state.empty())
    fail(ErrorKind::internal, "the state has {} numbers of refined cameras, but the run {}", state.size(),
         refiner_ ? "refines cameras" : "does not refine cameras");
  if (refiner_) refiner_->set_state(state);
}

}  // namespace ubs
