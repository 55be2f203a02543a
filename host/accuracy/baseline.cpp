// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/baseline.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "host/accuracy/accuracy_report.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"

namespace ubs::accuracy {
namespace {

constexpr double kWorse = 2, kNegligible = 3e-7;
constexpr std::size_t kShown = 12;

// JSON has no infinity.
double finite_or_not(const Json& value) {
  return value.is_null() ? std::numeric_limits<double>::infinity() : value.get<double>();
}

// Of accuracy_json().
std::vector<BaselineRow> rows_of(const Json& results) {
  std::vector<BaselineRow> rows;
  for (const Json& r : results) {
    if (r.contains("note")) continue;
    const auto word = [&](const char* which) { return r.at(which).get<std::string>(); };
    const auto add = [&](const std::string& stage, const std::string& operation, const Json& errors) {
      const double time = finite_or_not(r.at("times").at(operation).at("ratio"));
      for (const auto& [quantity, e] : errors.items())
        rows.push_back({word("device"), word("scene"), word("configuration"), stage, quantity,
                        finite_or_not(e.at("typical")), time});
    };
    add("end to end", "forward", {{"image", r.at("image")}});
    add("end to end", "iteration", r.at("gradient"));
    add("end to end, own signs of L1", "iteration", r.at("loss_gradient"));
    for (const auto& [stage, errors] : r.at("stages").items())
      add(stage, stage.substr(stage.rfind(' ') + 1), errors);  // "lists + raster_forward"
  }
  return rows;
}

auto key(const BaselineRow& r) { return std::tie(r.device, r.scene, r.configuration, r.stage, r.quantity); }

double ratio(const BaselineComparison& c) { return c.error / std::max(c.old_error, 1e-300); }

}  // namespace

std::vector<BaselineRow> read_accuracy_baseline(const std::filesystem::path& file) {
  try {
    return rows_of(parse_own_json(read_text_file(file), file.string()).at("results"));
  } catch (const Json::exception&) {
    fail(ErrorKind::data, "{}: is no accuracy.json that 'ubs accuracy' wrote", file.string());
  }
}

std::vector<BaselineComparison> compare_with_baseline(std::span<const Result> results,
                                                      std::span<const BaselineRow> baseline) {
  std::vector<BaselineComparison> all;
  for (const BaselineRow& now : rows_of(accuracy_json(results))) {
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
