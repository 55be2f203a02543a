// SPDX-License-Identifier: Apache-2.0
// A randomised campaign: many small cases, each compared with float64, oracles in parallel. The result is a
// function of (seed, first, cases, device).
#pragma once

#include "host/stress/row.hpp"
#include "host/stress/shrink.hpp"

namespace ubs::stress {

struct CampaignOptions {
  std::uint64_t seed = 1, first = 0, cases = 5000;  // numbers first .. first + cases - 1 of the seed
  std::function<bool(std::uint64_t done, std::uint64_t failed)> on_progress;  // false stops
};

struct Failure {
  Case c;
  Verdict verdict;
};

struct CampaignReport {
  std::vector<RowReport> forms;   // one a form of the method: "random.n6", "random.n6.cov_mode_whiten"
  std::vector<Failure> failures;  // the first five
  std::uint64_t cases = 0, failed = 0;
};

CampaignReport run_campaign(DeviceRunner& runner, const CampaignOptions& options);

}  // namespace ubs::stress
