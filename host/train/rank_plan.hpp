// SPDX-License-Identifier: Apache-2.0
// What a step of a training will take that ranks share (docs/cluster.md): from the parts of a step as one
// device takes them on views of the data, and a network of which only speed and latency are known.
#pragma once

#include <cstdint>

#include "host/device/device.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/splat_model.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

// Milliseconds of n splats: fixed + each * n.
struct LinearCost {
  double fixed = 0, each = 0;
  double operator()(double n) const { return fixed + each * n; }
};

// Of a device, of one view where nothing else is said.
struct RankCosts {
  LinearCost whole;                    // a view with its gradient in one process, which has all splats
  LinearCost project;                  // splats of a rank to records that can be sent
  LinearCost draw;                     // records that came to their gradient that can be sent
  LinearCost gradient;                 // that, to gradients of the parameters of a rank's splats
  LinearCost update;                   // step of the optimiser, of a rank's splats
  double drawn_share = 0;              // splats drawn of all
  double intersections_per_drawn = 0;  // tiles of a drawn splat
};

struct RankNetwork {
  double gigabytes_per_second = 10;  // of a rank, both ways at the same time
  double latency_us = 5;             // of a message, with what its receiver does for it
};

struct RankPrediction {
  int ranks = 1;
  double splats = 0;      // of a rank
  double compute_ms = 0;  // of the rank with most views
  double network_ms = 0;  // that nothing hides
  double sent_bytes = 0;  // of that rank
  double device_bytes = 0;
  double step_ms() const { return compute_ms + network_ms; }
};

// Measures on views of the split: with `model`, and with an eighth of it.
RankCosts measure_rank_costs(Device& device, const TrainSettings& settings, const Split& train,
                             const SplatModel& model);

// A step of `batch` views. `memory`: of a rank's device, of which splats and intersections are set here.
RankPrediction predict_ranks(const RankCosts& costs, double splats, int batch, int ranks,
                             const RankNetwork& network, MemoryQuestion memory);

}  // namespace ubs
