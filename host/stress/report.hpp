// SPDX-License-Identifier: Apache-2.0
// A stress run as a table on the screen, as JSON, and as a page.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

#include "host/stress/row.hpp"

namespace ubs::stress {

// What a run is stored with.
struct RunFacts {
  std::string device, raster, version, date, command;
  std::uint64_t seed = 0, first = 0, cases = 0;
  double seconds = 0;
};

std::string table_header();
std::string table_row(const RowReport& report);
// Cases by outcome and limits met, over all rows.
std::string summary_text(std::span<const RowReport> reports);

nlohmann::ordered_json to_json(std::span<const RowReport> reports, const RunFacts& facts);
std::string page(std::span<const RowReport> reports, const RunFacts& facts);

}  // namespace ubs::stress
