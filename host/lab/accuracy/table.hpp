// SPDX-License-Identifier: Apache-2.0
// These functions format the table of `ubs-lab accuracy`, which contains errors and times. Its formats are
// text, CSV and JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

#include "host/lab/accuracy/measure.hpp"

namespace ubs::accuracy {

// These functions return the header and the rows of the text table. The table has one row per configuration.
// For each stage, a row shows the typical error of the worst quantity and the time in ms.
std::string table_header();
std::string table_row(const Result& result);

// These functions return the results as CSV text and as JSON. For each configuration and stage, both contain
// the errors of each quantity.
std::string table_csv(std::span<const Result> results);
nlohmann::ordered_json table_json(std::span<const Result> results);

}  // namespace ubs::accuracy
