// SPDX-License-Identifier: Apache-2.0
// A field of comma-separated values: in quotes where it holds a comma or a quote.
#pragma once

#include <string>

namespace ubs::accuracy {

std::string csv_field(const std::string& text);

}  // namespace ubs::accuracy
