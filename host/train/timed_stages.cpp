// SPDX-License-Identifier: Apache-2.0
#include "host/train/timed_stages.hpp"

namespace ubs {
namespace {

constexpr int kEvery = 53, kFirst = 29;  // not the first iterations, in which kernels are compiled
constexpr std::array<std::string_view, 13> kNames{
    "project_forward",  "lists",      "raster_forward", "image_loss", "raster_backward", "sum_slots",
    "project_backward", "regularise", "adam",           "learn",      "relocate",        "grow",
    "add_noise"};

using Clock = std::chrono::steady_clock;

}  // namespace

void TimedStages::begin_iteration(int iteration, bool refines) {
  training_ = true;
  sampling_ = refines || iteration % kEvery == kFirst;
  if (sampling_) device_.finish();
}

void TimedStages::pause() { training_ = sampling_ = false; }

template <typename Call>
auto TimedStages::timed(Kind kind, const Call& call) {
  if (!training_) return call();
  Account& account = accounts_[kind];
  ++account.calls;
  if (!sampling_) return call();
  struct Watch {  // call() may return nothing
    Account& account;
    Device& device;
    Clock::time_point start = Clock::now();
    void stop() {
      device.finish();
      account.seconds += std::chrono::duration<double>(Clock::now() - start).count();
      ++account.sampled;
    }
  } watch{account, device_};
  if constexpr (std::is_void_v<decltype(call())>) {
    call();
    watch.stop();
  } else {
    auto result = call();
    watch.stop();
    return result;
  }
}

std::vector<StageTime> TimedStages::times() const {
  static_assert(kNames.size() == kinds_);
  std::vector<StageTime> times;
  for (std::size_t i = 0; i < kinds_; ++i) {
    const Account& a = accounts_[i];
    if (a.calls == 0) continue;
    const double each = a.sampled > 0 ? a.seconds / static_cast<double>(a.sampled) : 0;
    times.push_back({kNames[i], a.calls, a.sampled, each * static_cast<double>(a.calls)});
  }
  return times;
}

void TimedStages::project_forward(const ProjectForward& a) {
  timed(project_forward_, [&] { stages_->project_forward(a); });
}
ListTotals TimedStages::count_lists(const CountLists& a) {
  return timed(lists_, [&] { return stages_->count_lists(a); });
}
void TimedStages::build_lists(const BuildLists& a) {
  timed(lists_, [&] { stages_->build_lists(a); });
}
void TimedStages::raster_forward(const RasterForward& a) {
  timed(raster_forward_, [&] { stages_->raster_forward(a); });
}
void TimedStages::image_loss(const ImageLoss& a) {
  timed(image_loss_, [&] { stages_->image_loss(a); });
}
void TimedStages::raster_backward(const RasterBackward& a) {
  timed(raster_backward_, [&] { stages_->raster_backward(a); });
}
void TimedStages::sum_slots(const SumSlots& a) {
  timed(sum_slots_, [&] { stages_->sum_slots(a); });
}
void TimedStages::project_backward(const ProjectBackward& a) {
  timed(project_backward_, [&] { stages_->project_backward(a); });
}
void TimedStages::regularise(const Regularise& a) {
  timed(regularise_, [&] { stages_->regularise(a); });
}
void TimedStages::adam(const AdamStep& a) {
  timed(adam_, [&] { stages_->adam(a); });
}
void TimedStages::learn(const Learn& a) {
  timed(learn_, [&] { stages_->learn(a); });
}
// What was enqueued before is not part of it.
std::uint32_t TimedStages::relocate(const Relocate& a) {
  if (training_ && !sampling_) device_.finish();
  sampling_ = training_;
  return timed(relocate_, [&] { return stages_->relocate(a); });
}
void TimedStages::grow(const Grow& a) {
  timed(grow_, [&] { stages_->grow(a); });
}
void TimedStages::add_noise(const AddNoise& a) {
  timed(add_noise_, [&] { stages_->add_noise(a); });
}

}  // namespace ubs
