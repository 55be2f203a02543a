// SPDX-License-Identifier: Apache-2.0
// The table of `ubs-lab accuracy`, error beside time, as text, CSV and JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

#include "host/lab/accuracy/measure.hpp"

namespace ubs::accuracy {

// One row per form. For each stage it has the typical error of the worst quantity, and the time in ms.
std::string table_header();
std::string table_row(const Result& result);

// One row per form, stage and quantity.
std::string table_csv(std::span<const Result> results);
nlohmann::ordered_json table_json(std::span<const Result> results);

}  // namespace ubs::accuracy
