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
#include "host/settings/train_settings.hpp"

namespace ubs {

// LinearCost is a time that depends linearly on a number n of splats: fixed + each * n milliseconds.
struct LinearCost {
  double fixed = 0, each = 0;
  double operator()(double n) const { return fixed + each * n; }
};

// RankCosts holds the measured times of the parts of a step on one device. Except for `update`, they are
// times per view.
struct RankCosts {
  // A complete training step with one view in a single process that has all splats.
  LinearCost whole;
  // Projecting the splats of a rank, until their records can be sent.
  LinearCost project;
  // Rendering the received records and computing their gradients, until these can be sent.
  LinearCost draw;
  // Computing the gradients of the parameters from the received gradients of the records.
  LinearCost gradient;
  // The optimiser step for the splats of a rank. This is a time per step.
  LinearCost update;
  double drawn_share = 0;              // share of the splats that are visible in a view
  double intersections_per_drawn = 0;  // mean number of tiles of a visible splat
};

struct RankNetwork {
  double gigabytes_per_second = 10;  // per rank, in both directions at the same time
  double latency_us = 5;             // per message, including the work of the receiver
};

struct RankPrediction {
  int ranks = 1;
  double splats = 0;        // number of splats per rank
  double compute_ms = 0;    // on the rank that renders the most views
  double network_ms = 0;    // communication that does not overlap with computation
  double sent_bytes = 0;    // number of bytes that each rank sends
  double device_bytes = 0;  // device memory of a rank
  double step_ms() const { return compute_ms + network_ms; }
};

// Measures the costs on views of the split, with `model` and with an eighth of its splats.
RankCosts measure_rank_costs(Device& device, const TrainSettings& settings, const Split& train,
                             const SplatModel& model);

// Predicts the time and the memory of a step with `batch` views. `memory` contains the other inputs of the
// memory estimate; the function sets its numbers of splats and intersections.
RankPrediction predict_ranks(const RankCosts& costs, double splats, int batch, int ranks,
                             const RankNetwork& network, MemoryQuestion memory);

}  // namespace ubs
