// SPDX-License-Identifier: Apache-2.0
// Comma-separated values as the accuracy tools write and read them: a header line, fields in quotes where
// they hold a comma or a quote.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace ubs::accuracy {

std::string csv_field(const std::string& text);

// One map a row, from column to value. Throws Error(data) naming file and line where a row has not as many
// fields as the header, or a column of `required` is missing.
std::vector<std::map<std::string, std::string>> read_csv(const std::filesystem::path& file,
                                                         const std::vector<std::string>& required);
// Throws Error(data).
double csv_number(const std::string& text, const std::filesystem::path& file);

}  // namespace ubs::accuracy
