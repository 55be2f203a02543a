// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/csv.hpp"

#include "host/base/text.hpp"

namespace ubs::accuracy {

std::string csv_field(const std::string& bytes) {
  const std::string text = encode_text(bytes);
  if (text.find_first_of(",\"") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + '"';
}

}  // namespace ubs::accuracy
