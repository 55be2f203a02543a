// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/baseline.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "host/accuracy/csv.hpp"

namespace ubs::accuracy {
namespace {

constexpr double kWorse = 2, kNegligible = 3e-7;
constexpr std::size_t kShown = 12;

void add(std::vector<BaselineRow>& rows, const Result& r, const StageErrors& errors) {
  const OperationTime& time = r.time(errors.operation);
  for (const NamedErrors& e : errors.quantities)
    rows.push_back(
        {r.device, r.scene, r.configuration, errors.stage, e.quantity, e.errors.typical, time.ratio});
}

std::vector<BaselineRow> rows_of(std::span<const Result> results) {
  std::vector<BaselineRow> rows;
  for (const Result& r : results) {
    if (!r.note.empty() || r.times.empty()) continue;
    add(rows, r, r.image);
    add(rows, r, r.gradient);
    add(rows, r, r.loss_gradient);
    for (const StageErrors& s : r.stages) add(rows, r, s);
  }
  return rows;
}

auto key(const BaselineRow& r) { return std::tie(r.device, r.scene, r.configuration, r.stage, r.quantity); }

double ratio(const BaselineComparison& c) { return c.error / std::max(c.old_error, 1e-300); }

}  // namespace

std::vector<BaselineRow> read_accuracy_baseline(const std::filesystem::path& file) {
  std::vector<BaselineRow> rows;
  for (auto& row : read_csv(
           file, {"device", "scene", "configuration", "stage", "quantity", "typical_error", "time_ratio"}))
    rows.push_back({row["device"], row["scene"], row["configuration"], row["stage"], row["quantity"],
                    csv_number(row["typical_error"], file), csv_number(row["time_ratio"], file)});
  return rows;
}

std::vector<BaselineComparison> compare_with_baseline(std::span<const Result> results,
                                                      std::span<const BaselineRow> baseline) {
  std::vector<BaselineComparison> all;
  for (const BaselineRow& now : rows_of(results)) {
    const auto old = std::ranges::find_if(baseline, [&](const BaselineRow& b) { return key(b) == key(now); });
    if (old == baseline.end()) continue;
    BaselineComparison c{fmt::format("{}, {}, {}, {}", now.scene, now.configuration, now.stage, now.quantity),
                         old->error,
                         now.error,
                         old->time_ratio,
                         now.time_ratio,
                         false};
    c.regression = !(c.error <= kWorse * c.old_error) && !(c.error <= kNegligible);
    all.push_back(c);
  }
  return all;
}

std::string baseline_text(std::span<const BaselineComparison> comparisons) {
  if (comparisons.empty()) return "the baseline has no row of these devices, scenes and configurations\n";
  std::vector<BaselineComparison> order(comparisons.begin(), comparisons.end());
  std::ranges::stable_sort(order, [](const auto& a, const auto& b) {
    return std::pair(a.regression, std::abs(std::log(ratio(a) + 1e-300))) >
           std::pair(b.regression, std::abs(std::log(ratio(b) + 1e-300)));
  });
  std::string text = fmt::format("{:<60} {:>9} {:>9} {:>7}  {:>6} {:>6}\n", "against the baseline",
                                 "old error", "new error", "ratio", "time", "now");
  const auto regressions =
      static_cast<std::size_t>(std::ranges::count_if(order, &BaselineComparison::regression));
  for (std::size_t i = 0; i < std::min(order.size(), std::max(kShown, regressions)); ++i) {
    const BaselineComparison& c = order[i];
    text += fmt::format("{:<60} {:>9.2e} {:>9.2e} {:>7.2f}  {:>6.3f} {:>6.3f}{}\n", c.what, c.old_error,
                        c.error, ratio(c), c.old_time, c.time, c.regression ? "  WORSE" : "");
  }
  return text + fmt::format("{} of {} errors are worse than twice the baseline\n", regressions, order.size());
}

}  // namespace ubs::accuracy
