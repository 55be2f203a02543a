// SPDX-License-Identifier: Apache-2.0
// predict_ranks() estimates the time of a training step that several ranks share (docs/cluster.md). The parts
// of a step are measured on one device with views of the data. The network is described only by its speed and
// its latency.
#pragma once

#include <cstdint>

#include "host/device/device.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/splat_model.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

// Milliseconds for n splats: fixed + each * n.
struct LinearCost {
  double fixed = 0, each = 0;
  double operator()(double n) const { return fixed + each * n; }
};

// Costs on one device. They are per view unless the comment says otherwise.
struct RankCosts {
  LinearCost whole;        // a view with its gradient, in one process that has all splats
  LinearCost project;      // from the splats of a rank to records that can be sent
  LinearCost draw;         // from received records to their gradients that can be sent
  LinearCost gradient;     // from received gradients to the parameter gradients of a rank's splats
  LinearCost update;       // optimiser step for a rank's splats; per step
  double drawn_share = 0;  // visible splats / all splats
  double intersections_per_drawn = 0;  // tiles per visible splat
};

struct RankNetwork {
  double gigabytes_per_second = 10;  // per rank, in both directions at the same time
  double latency_us = 5;             // per message, including the work of the receiver
};

struct RankPrediction {
  int ranks = 1;
  double splats = 0;      // per rank
  double compute_ms = 0;  // on the rank that renders the most views
  double network_ms = 0;  // communication that does not overlap with computation
  double sent_bytes = 0;  // bytes that this rank sends
  double device_bytes = 0;
  double step_ms() const { return compute_ms + network_ms; }
};

// Measures the costs on views of the split, with `model` and with an eighth of its splats.
RankCosts measure_rank_costs(Device& device, const TrainSettings& settings, const Split& train,
                             const SplatModel& model);

// Predicts a step of `batch` views. `memory` describes the device of a rank; its numbers of splats and
// intersections are set here.
RankPrediction predict_ranks(const RankCosts& costs, double splats, int batch, int ranks,
                             const RankNetwork& network, MemoryQuestion memory);

}  // namespace ubs
