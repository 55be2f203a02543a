// SPDX-License-Identifier: Apache-2.0
#include "host/train/rank_plan.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "host/base/stopwatch.hpp"
#include "host/device/operations.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/shared_renderer.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/train/kernel_warm_up.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/target_images.hpp"
#include "host/train/target_loss.hpp"

namespace ubs {
namespace {

// kViews is the maximum number of views that are measured. They are measured with all splats, and with a
// number of splats that is smaller by the factor kFewer.
constexpr std::size_t kViews = 6, kFewer = 8;
constexpr int kTimes = 5;  // number of runs of which the fastest is used
constexpr std::size_t kRecordBytes = kSplatStride * sizeof(float);
// Additional bytes per visible splat on the rank that renders a view. They contain the record, its gradient
// and the gradient of the previous view, and the depth key, the tile rectangle, the tile count and the slot
// offset.
constexpr double kDrawnBytes = 3 * kRecordBytes + 20;
// Number of rounds that are transferred at the same time. The buffers of each round hold the records or the
// gradients, and VisibleSplats::places.
constexpr double kRounds = 3;

struct RankTimes {
  // Times in ms. Except for `update`, these are means over the views.
  double whole = 0, project = 0, draw = 0, gradient = 0, update = 0;
  double splats = 0, drawn = 0, intersections = 0;  // numbers per view
};

// RankStep holds a model on the device and the buffers of a training step. It measures the parts of a step.
class RankStep {
 public:
  RankStep(Device& device, const TrainSettings& settings, const Split& views, const SplatModel& model)
      : device_(device),
        settings_(settings),
        stages_(make_stages(device, training_config(settings, device.info()))),
        model_(device, model, model.count),
        owner_(device, *stages_),
        drawer_(device, *stages_),
        targets_(device, kTargetBudgetBytes),
        sums_(device, "loss sums", 8),
        rates_(device, "learning rates", static_cast<std::size_t>(model_.rows())) {
    const auto rows = static_cast<std::size_t>(trained_rows(model_.layout(), stages_->config().frozen));
    for (Buffer<float>* buffer : {&v_params_, &moment1_, &moment2_}) {
      *buffer = Buffer<float>(device, "rank costs", rows * model_.stride());
      buffer->zero();
    }
    rates_.zero();
    targets_.add(views);
    owner_.set_cameras(cameras_of(views));
    drawer_.set_cameras(cameras_of(views));
  }

  RankTimes measure(std::uint32_t views) {
    RankTimes t{.splats = static_cast<double>(model_.count())};
    const double share = 1.0 / views;
    for (std::uint32_t view = 0; view < views; ++view) {
      t.whole += share * least_ms([&] {
                   drawer_.forward(model_.view(), view, render(), true);
                   loss(view);
                   drawer_.backward_to_records();
                   drawer_.learn(false, penalty(), step());
                 });
      // Simulates the exchange: the data that this rank sends are received as if another rank had sent them.
      VisibleSplats seen;
      Buffer<float> gradient;
      TransferBuffer sent, come, sent_back, come_back;
      std::span<const std::byte> on_the_way;
      std::uint32_t drawn = 0;
      const auto receive = [&](TransferBuffer& freight, Buffer<float>& rows) {
        std::ranges::copy(on_the_way, freight.in(alone(), rows, on_the_way.size()));
        freight.arrived(device_, rows);
      };
      t.project += share * least_ms([&] {
                     drawn = owner_.project_only(model_.view(), view, render(), seen);
                     on_the_way = sent.out(alone(), device_, seen.rows, drawn * kRecordBytes);
                   });
      ListTotals totals;
      t.draw += share * least_ms([&] {
                  receive(come, drawer_.drawn_records(drawn, true));
                  totals = drawer_.forward_projected(drawn, view, render(), true);
                  loss(view);
                  drawer_.backward_to_records();
                  drawer_.take_v_records(gradient);
                  sent_back.out(alone(), device_, gradient, drawn * kRecordBytes);
                });
      on_the_way = sent_back.out(alone(), device_, gradient, drawn * kRecordBytes);
      t.gradient += share * least_ms([&] {
                      const BufferView<float> v_params = v_params_.view();
                      receive(come_back, seen.rows);
                      owner_.take_gradient(model_.view(), view, render(), seen);
                      owner_.backward_from_records(std::span(&v_params, 1), true);
                    });
      t.drawn += share * static_cast<double>(drawn);
      t.intersections += share * static_cast<double>(totals.intersections);
    }
    t.update = least_ms([&] { stages_->adam(step()); });
    return t;
  }

 private:
  RenderSettings render() const { return render_settings(settings_); }
  void loss(std::uint32_t view) {
    stages_->image_loss(training_loss(drawer_, targets_.get(view), settings_, sums_.view()));
  }
  Regularise penalty() { return {.splats = model_.view(), .v_params = v_params_.view()}; }
  AdamStep step() {  // learning rates are 0
    return {.splats = model_.view(),
            .v_params = v_params_.view(),
            .moment1 = moment1_.view(),
            .moment2 = moment2_.view(),
            .learning_rates = rates_.view(),
            .step = 1};
  }
  // Returns the minimum time of kTimes runs. The first run is not counted, because it may compile kernels.
  double least_ms(const std::function<void()>& work) {
    work();
    device_.finish();
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < kTimes; ++i) {
      const Stopwatch watch;
      work();
      device_.finish();
      least = std::min(least, watch.milliseconds());
    }
    return least;
  }

  Device& device_;
  const TrainSettings& settings_;
  std::unique_ptr<Stages> stages_;
  DeviceModel model_;
  Renderer owner_, drawer_;
  TargetImages targets_;
  Buffer<float> v_params_, moment1_, moment2_, sums_, rates_;
};

LinearCost line_through(double n0, double ms0, double n1, double ms1) {
  const double each = n1 > n0 ? std::max(0.0, (ms1 - ms0) / (n1 - n0)) : 0;
  return {std::max(0.0, ms1 - each * n1), each};
}

}  // namespace

RankCosts measure_rank_costs(Device& device, const TrainSettings& settings, const Split& train,
                             const SplatModel& model) {
  Split views{"some", {}};
  const std::size_t count = std::min(kViews, train.views.size());
  for (std::size_t i = 0; i < count; ++i) views.views.push_back(train.views[i * train.views.size() / count]);
  const auto measured = [&](const SplatModel& some) {
    return RankStep(device, settings, views, some).measure(static_cast<std::uint32_t>(count));
  };
  const RankTimes few = measured(copies(model, std::max<std::size_t>(1, model.count / kFewer))),
                  all = measured(model);
  const auto line = [&](double RankTimes::*ms, double RankTimes::*n) {
    return line_through(few.*n, few.*ms, all.*n, all.*ms);
  };
  return {.whole = line(&RankTimes::whole, &RankTimes::splats),
          .project = line(&RankTimes::project, &RankTimes::splats),
          .draw = line(&RankTimes::draw, &RankTimes::drawn),
          .gradient = line(&RankTimes::gradient, &RankTimes::splats),
          .update = line(&RankTimes::update, &RankTimes::splats),
          .drawn_share = all.drawn / all.splats,
          .intersections_per_drawn = all.drawn > 0 ? all.intersections / all.drawn : 0};
}

RankPrediction predict_ranks(const RankCosts& costs, double splats, int batch, int ranks,
                             const RankNetwork& network, MemoryQuestion memory) {
  RankPrediction p{.ranks = ranks, .splats = splats / ranks};
  const double drawn = costs.drawn_share * splats;
  memory.splats = static_cast<std::size_t>(std::ceil(p.splats));
  memory.intersections = static_cast<std::uint64_t>(drawn * costs.intersections_per_drawn);
  p.device_bytes = static_cast<double>(plan_memory(memory).total());
  if (ranks == 1) {
    p.compute_ms = batch * costs.whole(splats);
    return p;
  }
  p.device_bytes += drawn * kDrawnBytes;
  p.device_bytes +=
      kRounds * std::min(batch, ranks) * (drawn / ranks * kRecordBytes + p.splats * sizeof(std::uint32_t));
  // Number of views of the rank that renders the most views.
  const double rounds = std::ceil(static_cast<double>(batch) / ranks);
  p.compute_ms = batch * (costs.project(p.splats) + costs.gradient(p.splats)) + rounds * costs.draw(drawn) +
                 costs.update(p.splats);
  // A rank sends the records of its splats and the gradients of its views, and receives the gradients of its
  // splats and the records of its views.
  const double away = (ranks - 1.0) / ranks;
  p.sent_bytes = away * kRecordBytes * drawn * (static_cast<double>(batch) / ranks + rounds);
  const double doublings = std::ceil(std::log2(ranks));
  // The first term is the number of messages with the sizes and the data of the exchanges. The second term is
  // the number of messages for the sums over all ranks.
  const double messages = 2 * rounds * (doublings + ranks - 1) + 4 * doublings;
  const double all_ms =
      1e3 * p.sent_bytes / (1e9 * network.gigabytes_per_second) + 1e-3 * network.latency_us * messages;
  // A rank waits only for the first records and the last gradients. All other data are transferred while
  // views are rendered.
  const double hidden = std::min(all_ms * (1 - 1 / rounds), (rounds - 1) * costs.draw(drawn));
  p.network_ms = all_ms - hidden;
  return p;
}

}  // namespace ubs
