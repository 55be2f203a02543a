// SPDX-License-Identifier: Apache-2.0
#include "host/stress/report.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "host/base/json.hpp"
#include "host/base/text.hpp"
#include "host/stress/known_limits.hpp"

namespace ubs::stress {
namespace {

// Errors above 1 are all the same: no digit is right.
std::string error_text(double error) {
  return error == 0 ? "0" : error > 1 ? "> 1" : fmt::format("{:.1e}", error);
}

struct Totals {
  std::size_t cases = 0, pixels = 0, undecided = 0, drawn = 0, culled = 0;
  std::array<std::size_t, kOutcomes> outcomes{};
  std::map<std::string, LimitCount> limits;
};

Totals totals_of(std::span<const RowReport> reports) {
  Totals t;
  for (const RowReport& r : reports) {
    t.cases += r.cases, t.pixels += r.pixels, t.undecided += r.undecided, t.drawn += r.drawn,
        t.culled += r.culled;
    for (std::size_t i = 0; i < kOutcomes; ++i) t.outcomes[i] += r.outcomes[i];
    for (const auto& [name, count] : r.limits) t.limits[name].add(count);
  }
  return t;
}

// One table for pages: | cells |.
std::string line(std::vector<std::string> cells) {
  for (std::string& cell : cells) cell = table_cell(std::move(cell));
  return fmt::format("| {} |\n", fmt::join(cells, " | "));
}

std::string bound_text(double factor, double lost) {
  if (lost == std::numeric_limits<double>::infinity()) return fmt::format("{:g} r", factor);
  return fmt::format("{:g} r, none from r = {:g}", factor, lost);
}

std::string limits_table(const Totals& totals) {
  std::string text = "r = 2^-24 times the number.\n\n";
  text += line({"limit", "number", "value error", "gradient error", "met in", "worst value", "worst gradient",
                "observed factors"});
  text += "|---|---|---|---|---|---|---|---|\n";
  for (const KnownLimit& limit : known_limits()) {
    const auto found = totals.limits.find(limit.name);
    const LimitCount count = found == totals.limits.end() ? LimitCount{} : found->second;
    text += line({limit.name, limit.number, bound_text(limit.value, limit.value_lost),
                  bound_text(limit.gradient, limit.gradient_lost), fmt::format("{} cases", count.cases),
                  error_text(count.value_error), error_text(count.gradient_error),
                  fmt::format("{:.2g}, {:.2g}", count.value_factor, count.gradient_factor)});
  }
  return text;
}

// JSON has no infinity.
Json number(double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); }

Json row_json(const RowReport& r) {
  Json outcomes = Json::object(), limits = Json::object();
  for (std::size_t i = 0; i < kOutcomes; ++i)
    outcomes[std::string(to_string(static_cast<Outcome>(i)))] = r.outcomes[i];
  for (const auto& [name, count] : r.limits)
    limits[name] = {{"cases", count.cases},
                    {"value_error", number(count.value_error)},
                    {"gradient_error", number(count.gradient_error)},
                    {"value_factor", count.value_factor},
                    {"gradient_factor", count.gradient_factor}};
  return {{"name", r.name},
          {"what", r.what},
          {"outcome", to_string(r.outcome)},
          {"cases", r.cases},
          {"value_error", number(r.value_error)},
          {"gradient_error", number(r.gradient_error)},
          {"finite", r.finite},
          {"drawn", r.drawn},
          {"culled", r.culled},
          {"pixels", r.pixels},
          {"undecided_pixels", r.undecided},
          {"seconds", r.seconds},
          {"outcomes", outcomes},
          {"known_limits", limits},
          {"note", r.note}};
}

}  // namespace

std::string table_header() {
  return fmt::format("{:<32} {:<9} {:>6} {:>8} {:>8} {:>6} {:>7} {:>9} {:>8}", "case", "outcome", "cases",
                     "value", "gradient", "finite", "culled", "undecided", "seconds");
}

std::string table_row(const RowReport& r) {
  const double undecided =
      r.pixels == 0 ? 0 : 100.0 * static_cast<double>(r.undecided) / static_cast<double>(r.pixels);
  std::string text =
      fmt::format("{:<32} {:<9} {:>6} {:>8} {:>8} {:>6} {:>7} {:>8.2f}% {:>8.1f}", r.name,
                  to_string(r.outcome), r.cases, error_text(r.value_error), error_text(r.gradient_error),
                  r.finite ? "yes" : "NO", r.culled, undecided, r.seconds);
  if (!r.note.empty()) text += "\n    " + r.note.substr(0, 400);
  return text;
}

std::string summary_text(std::span<const RowReport> reports) {
  const Totals t = totals_of(reports);
  std::string text =
      fmt::format("{} cases compared with float64:",
                  t.outcomes[0] + t.outcomes[1] + t.outcomes[2] + t.outcomes[3] + t.outcomes[4]);
  for (std::size_t i = 0; i < kOutcomes; ++i)
    text += fmt::format(" {} {}", t.outcomes[i], to_string(static_cast<Outcome>(i)));
  text += fmt::format("; {} of {} pixels undecided\n", t.undecided, t.pixels);
  for (const auto& [name, count] : t.limits)
    text += fmt::format("  known limit {}: {} cases, value {}, gradient {}\n", name, count.cases,
                        error_text(count.value_error), error_text(count.gradient_error));
  return text;
}

Json to_json(std::span<const RowReport> reports, const RunFacts& facts) {
  Json rows = Json::array();
  for (const RowReport& r : reports) rows.push_back(row_json(r));
  return {{"version", facts.version},      {"date", facts.date},
          {"command", facts.command},      {"device", facts.device},
          {"raster", facts.raster},        {"seed", facts.seed},
          {"first", facts.first},          {"cases", facts.cases},
          {"seconds", facts.seconds},      {"promise", kPromise},
          {"conditioning", kConditioning}, {"rows", std::move(rows)}};
}

std::string page(std::span<const RowReport> reports, const RunFacts& facts) {
  const Totals totals = totals_of(reports);
  std::string text = "# Stress run\n\n";
  text += fmt::format("{}, rasteriser {}; {}; {}; `{}`; {:.0f} s.\n\n", facts.device, facts.raster,
                      facts.version, facts.date, facts.command, facts.seconds);
  text += summary_text(reports).substr(0, summary_text(reports).find('\n')) + ".\n\n";
  text += line({"case", "what", "outcome", "cases", "value error", "gradient error", "finite", "culled",
                "undecided pixels", "s"});
  text += "|---|---|---|---|---|---|---|---|---|---|\n";
  for (const RowReport& r : reports)
    text += line({r.name, r.note.empty() ? r.what : r.what + "; " + r.note.substr(0, 160),
                  std::string(to_string(r.outcome)), fmt::format("{}", r.cases), error_text(r.value_error),
                  error_text(r.gradient_error), r.finite ? "yes" : "no", fmt::format("{}", r.culled),
                  fmt::format("{} of {}", r.undecided, r.pixels), fmt::format("{:.1f}", r.seconds)});
  return text + "\n## Known limits\n\n" + limits_table(totals);
}

}  // namespace ubs::stress
