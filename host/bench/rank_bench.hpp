// SPDX-License-Identifier: Apache-2.0
// Steps of a training that ranks share (docs/cluster.md): where the time of each rank goes, what it sends,
// and what it waits for.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "host/bench/training_bench.hpp"
#include "host/cluster/communicator.hpp"

namespace ubs::bench {

// Of one rank; times and bytes a step.
struct RankMeasurement {
  Summary wall_ms;
  double mean_ms = 0;            // as what follows
  double cpu_ms = 0;             // processor time of the process
  double device_peak_bytes = 0;  // most so far
  double sent_bytes = 0;         // to other ranks
  double messages = 0;           // exchanges and sums
  // In calls that wait for other ranks; of that, what the same bytes take when nobody is late.
  double communicating_ms = 0, moving_ms = 0;
  // Of a sampled step, which waits after every stage.
  std::vector<std::pair<std::string, double>> stage_ms;
};

// As measure_iterations(). All ranks, each with the same scene.
RankMeasurement measure_ranks(Device& device, const BenchScene& scene, const IterationOptions& options,
                              Communicator& ranks);

// Of all ranks, on all of them: a list of objects.
nlohmann::ordered_json gather(Communicator& ranks, const RankMeasurement& own);
// A column a rank.
std::string to_text(const nlohmann::ordered_json& ranks);

}  // namespace ubs::bench
