// SPDX-License-Identifier: Apache-2.0
// The part of the trainer that keeps its state: handing it out, taking it back, and answering values that are
// not finite.
#include <cmath>

#include "host/base/error.hpp"
#include "host/train/stage_inspector.hpp"
#include "host/train/target_loss.hpp"
#include "host/train/trainer.hpp"

namespace ubs {
namespace {

constexpr double kBeta1 = AdamStep{}.beta1, kBeta2 = AdamStep{}.beta2, kEpsilon = AdamStep{}.epsilon;

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

SplatModel without_nonfinite(SplatModel model, std::size_t& replaced) {
  for (float& value : model.values)
    if (!std::isfinite(value)) {
      value = 0;
      ++replaced;
    }
  return model;
}

}  // namespace

TrainState Trainer::state() const {
  TrainState s;
  s.model = model_.download();
  s.moment1 = download_compact(moment1_, model_.stride(), model_.count());
  s.moment2 = download_compact(moment2_, model_.stride(), model_.count());
  s.iteration = iteration_;
  s.logged = logged_;
  s.adam_steps = adam_steps_;
  s.seconds = seconds_;
  s.loss_sums = loss_sums_.download();
  if (iteration_ == 0) std::ranges::fill(s.loss_sums, 0.0f);  // nothing has been written yet
  if (appearance_) s.appearance = appearance_.download();
  s.skipped_draws = skipped_draws_;
  s.rollbacks = rollbacks_;
  s.dropped = dropped_;
  return s;
}

void Trainer::restore(const TrainState& s) {
  model_.upload(s.model);
  upload_compact(moment1_, model_.stride(), model_.count(), s.moment1);
  upload_compact(moment2_, model_.stride(), model_.count(), s.moment2);
  if (s.loss_sums.size() != loss_sums_.size())
    fail(ErrorKind::internal, "{} loss sums for {}", s.loss_sums.size(), loss_sums_.size());
  loss_sums_.upload(s.loss_sums);
  if (s.appearance.size() != appearance_.size())
    fail(ErrorKind::internal, "{} numbers of the images' appearance for {}", s.appearance.size(),
         appearance_.size());
  if (appearance_) appearance_.upload(s.appearance);
  iteration_ = looked_ = s.iteration;
  logged_ = s.logged;
  adam_steps_ = s.adam_steps;
  adam_history_.fill(s.adam_steps);
  seconds_ = saved_seconds_ = s.seconds;
  skipped_draws_ = s.skipped_draws;
  rollbacks_ = s.rollbacks;
  dropped_ = s.dropped;
  if (sentinel_) sentinel_.zero();
  if (on_nan_ == OnNan::rollback) good_ = s;
}

bool Trainer::save_due() const {
  return schedule_.save && ((schedule_.iterations > 0 && iteration_ % schedule_.iterations == 0) ||
                            (schedule_.seconds > 0 && seconds_ - saved_seconds_ >= schedule_.seconds));
}

// Relocation, growth or noise may have left a value that the next step will notice: then the last state
// stays.
void Trainer::save_state() {
  saved_seconds_ = seconds_;
  TrainState s = state();
  if (!is_finite(s)) return;
  schedule_.save(s);
  if (on_nan_ == OnNan::rollback) good_ = std::move(s);
}

// Before anything but Adam changes the state, and before anyone sees it.
bool Trainer::look_due(bool reads_or_saves) const {
  if (on_nan_ == OnNan::off) return false;
  return reads_or_saves || left_out_ || refines_at(iteration_ + 1) || settings_.noise_when == "every_step" ||
         static_cast<std::size_t>(iteration_ - looked_) >= kLookEvery;
}

bool Trainer::look() {
  if (on_nan_ == OnNan::off) return true;
  std::uint32_t stamp = 0;
  sentinel_.download(std::span(&stamp, 1));
  looked_ = iteration_;
  if (stamp == 0) return true;
  sentinel_.zero();
  iteration_ = looked_ = static_cast<int>(stamp);  // the steps since then did nothing
  adam_steps_ = adam_history_[stamp % adam_history_.size()];
  TrainState s = state();
  NonFiniteEvent event;
  event.iteration = iteration_;
  event.splats = splats_not_finite(s);
  describe_splat(s, event);
  inspect(s, event);
  answer(std::move(event), std::move(s));
  return false;
}

// The forward and backward pass of each view of the iteration again, stage by stage, on the model before it.
void Trainer::inspect(const TrainState& s, NonFiniteEvent& event) {
  const double steps = static_cast<double>(adam_steps_);
  AdamUndo undo{learning_rates(), 1 / (1 - std::pow(kBeta1, steps)),
                1 / std::sqrt(1 - std::pow(kBeta2, steps)), kEpsilon};
  const SplatModel before = undo_adam(s, undo);
  event.model = without_nonfinite(before, event.replaced);
  if (event.replaced > 0) {
    event.stage = "parameters";
    event.where =
        fmt::format("{} of them before the iteration: an earlier refinement, noise, or a change from outside",
                    event.replaced);
    return;
  }
  event.stage = "adam";
  event.where =
      "gradients and parameters are finite, moments are not: squares overflow from gradients of 6e20 on";
  const auto batch = static_cast<std::uint64_t>(settings_.batch);
  try {
    use_level_of(event.iteration);
    DeviceModel model(device_, before);
    Buffer<float> v_params(device_, "parameter gradients",
                           static_cast<std::size_t>(model.rows()) * model.stride());
    Buffer<float> sums(device_, "loss sums", 8);
    for (std::uint64_t b = 0; b < batch; ++b) {
      const std::uint64_t draw = static_cast<std::uint64_t>(event.iteration - 1) * batch + b;
      const std::uint32_t view = order_(draw);
      StageInspector stages(device_, *stages_);
      Renderer renderer(device_, stages);
      renderer.set_cameras({reduced(train_.views[view].camera, factor_)});
      renderer.forward(model.view(), 0, render_, true);
      stages.image_loss(loss_of_draw(renderer, draw, sums.view()));
      renderer.backward(v_params.view(), false);
      if (event.splat >= 0) {
        const std::vector<float> gradient = v_params.download();
        event.gradient.clear();
        for (std::size_t at = static_cast<std::size_t>(event.splat); at < gradient.size();
             at += model.stride())
          event.gradient.push_back(gradient[at]);
      }
      event.view = view;
      event.view_name = train_.views[view].name;
      if (!stages.finding()) continue;
      event.stage = stages.finding()->stage;
      event.where = stages.finding()->where;
      if (event.splat < 0 && stages.finding()->splat >= 0) {
        event.splats = {static_cast<std::uint32_t>(stages.finding()->splat)};
        describe_splat(s, event);
      } else if (stages.finding()->splat >= 0 && stages.finding()->splat != event.splat) {
        event.where += fmt::format(" (splat {})", stages.finding()->splat);
      }
      return;
    }
  } catch (const Error& error) {
    event.stage = "unknown";
    event.where = fmt::format("the iteration could not be repeated: {}", error.what());
  }
}

void Trainer::loss_not_finite(std::uint64_t draw) {
  const std::uint32_t view = order_(draw);
  const auto iteration = static_cast<int>(draw / static_cast<std::uint64_t>(settings_.batch)) + 1;
  if (on_nan_ == OnNan::off)
    fail(ErrorKind::numerical,
         "the loss is not finite at iteration {}, view '{}'; try smaller learning rates", iteration,
         train_.views[view].name);
  TrainState s = state();
  NonFiniteEvent event;
  event.iteration = iteration;
  inspect(s, event);
  event.view = view;
  event.view_name = train_.views[view].name;
  answer(std::move(event), std::move(s));
}

void Trainer::answer(NonFiniteEvent event, TrainState s) {
  const auto stop = [&](const std::string& why) {
    event.action = why;
    if (report_nonfinite_) report_nonfinite_(event);
    whole_ = false;  // the last good state is the one handed out last
    fail(ErrorKind::numerical, "{}; {}", summary(event), why);
  };
  if (on_nan_ == OnNan::rollback) {
    if (rollbacks_ >= kMostRollbacks) stop(fmt::format("stopped after {} rollbacks", rollbacks_));
    const auto batch = static_cast<std::uint64_t>(settings_.batch);
    const std::uint64_t first = static_cast<std::uint64_t>(event.iteration - 1) * batch;
    std::set<std::uint64_t> skipped = skipped_draws_;
    for (std::uint64_t draw = first; draw < first + batch; ++draw)
      if (event.view < 0 || order_(draw) == static_cast<std::uint32_t>(event.view)) skipped.insert(draw);
    const int rollbacks = rollbacks_ + 1;
    event.action =
        fmt::format("back to iteration {}, this view left out when its turn comes", good_->iteration);
    if (report_nonfinite_) report_nonfinite_(event);
    const double seconds = seconds_;
    restore(TrainState(*good_));
    seconds_ = seconds;  // they were spent
    skipped_draws_ = good_->skipped_draws = std::move(skipped);
    rollbacks_ = good_->rollbacks = rollbacks;
    return;
  }
  if (on_nan_ == OnNan::drop && !event.splats.empty()) {
    const auto most = std::max<std::uint64_t>(
        kFewDropped, static_cast<std::uint64_t>(kMostDroppedShare * static_cast<double>(s.model.count)));
    if (dropped_ + event.splats.size() > most)
      stop(fmt::format("stopped: {} splats would have been dropped, more than {}",
                       dropped_ + event.splats.size(), most));
    event.action = fmt::format("{} splats made dead", event.splats.size());
    if (report_nonfinite_) report_nonfinite_(event);
    kill_splats(s, event.splats);
    const auto batch = static_cast<std::uint64_t>(settings_.batch);
    for (std::uint64_t b = 1; b <= batch; ++b)  // their losses may not be finite either
      s.skipped_draws.insert(static_cast<std::uint64_t>(event.iteration) * batch - b);
    restore(s);
    return;
  }
  stop("stopped");
}

}  // namespace ubs
