// SPDX-License-Identifier: Apache-2.0
// See campaign.hpp. Batches: while the oracle uses all cores the device rests, and the other way round; CPU
// devices would have to share the cores anyway.
#include "host/stress/campaign.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/base/stopwatch.hpp"
#include "host/stress/random_case.hpp"

namespace ubs::stress {
namespace {

constexpr std::uint64_t kBatch = 64;
constexpr std::size_t kKeptFailures = 5;

std::string form_name(const Case& c) {
  std::string name = fmt::format("random.n{}", c.model.dim);
  for (const auto& [key, value] : non_default_switches(c.model.variant)) name += "." + key + "_" + value;
  return c.query_grad ? name + ".query_grad" : name;
}

}  // namespace

CampaignReport run_campaign(DeviceRunner& runner, const CampaignOptions& options) {
  CampaignReport report;
  std::map<std::string, RowReport> forms;
  while (report.cases < options.cases) {
    const std::uint64_t number = options.first + report.cases;
    const std::size_t count = static_cast<std::size_t>(std::min(kBatch, options.cases - report.cases));
    std::vector<Case> cases(count);
    std::vector<Expectation> expected(count);
    parallel_for(count, [&](std::size_t i) {
      cases[i] = random_case(options.seed, number + i);
      expected[i] = expect(cases[i]);
    });
    for (std::size_t i = 0; i < count; ++i) {
      const Stopwatch watch;
      const Verdict verdict = answer(cases[i], expected[i], runner);
      RowReport& form = forms[form_name(cases[i])];
      RowRun(runner, form).take(cases[i], verdict);
      form.seconds += watch.seconds();
      ++report.cases;
      if (verdict.outcome != Outcome::failed) continue;
      ++report.failed;
      if (report.failures.size() < kKeptFailures) report.failures.push_back({cases[i], verdict});
    }
    if (options.on_progress && !options.on_progress(report.cases, report.failed)) break;
  }
  for (auto& [name, form] : forms) {
    form.name = name;
    form.what = "random cases";
    report.forms.push_back(std::move(form));
  }
  return report;
}

}  // namespace ubs::stress
