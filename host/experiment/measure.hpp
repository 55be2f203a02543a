// SPDX-License-Identifier: Apache-2.0
// What a finished run is measured for beyond what training measures itself: frames a second and LPIPS, by
// `ubs eval` of its model in a process of its own. A measurement that fails costs its values, not the run;
// it is repeated when the experiment is resumed, and added to runs that were trained without it.
#pragma once

#include "host/experiment/runner.hpp"

namespace ubs::experiment {

// Adds to `result` of the whole run in `folder` what it does not have yet, and the reasons for what it still
// lacks then. Leaves eval.json (and measure.log) in the folder, which read_metrics() reads from then on.
void measure(const Job& job, const std::filesystem::path& folder, const RunOptions& options,
             JobResult& result);

}  // namespace ubs::experiment
