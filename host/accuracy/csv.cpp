// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/csv.hpp"

#include <algorithm>
#include <charconv>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/text.hpp"

namespace ubs::accuracy {
namespace {

std::vector<std::string> fields_of(const std::string& line) {
  std::vector<std::string> fields{""};
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '"') {
      if (quoted && i + 1 < line.size() && line[i + 1] == '"')
        fields.back() += line[++i];
      else
        quoted = !quoted;
    } else if (c == ',' && !quoted) {
      fields.emplace_back();
    } else if (c != '\r') {
      fields.back() += c;
    }
  }
  return fields;
}

}  // namespace

std::string csv_field(const std::string& bytes) {
  const std::string text = encode_text(bytes);
  if (text.find_first_of(",\"") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + '"';
}

std::vector<std::map<std::string, std::string>> read_csv(const std::filesystem::path& file,
                                                         const std::vector<std::string>& required) {
  const std::string text = read_text_file(file);
  std::vector<std::map<std::string, std::string>> rows;
  std::vector<std::string> header;
  std::size_t line_number = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string line = text.substr(at, end - at);
    at = end + 1;
    ++line_number;
    if (line.empty()) continue;
    const std::vector<std::string> fields = fields_of(line);
    if (header.empty()) {
      header = fields;
      for (const std::string& column : required)
        if (std::ranges::find(header, column) == header.end())
          fail(ErrorKind::data, "{}: no column '{}'", file.string(), column);
      continue;
    }
    if (fields.size() != header.size())
      fail(ErrorKind::data, "{}:{}: {} fields, the header has {}", file.string(), line_number, fields.size(),
           header.size());
    auto& row = rows.emplace_back();
    for (std::size_t i = 0; i < fields.size(); ++i) row[header[i]] = decode_text(fields[i]);
  }
  if (header.empty()) fail(ErrorKind::data, "{}: is empty", file.string());
  return rows;
}

double csv_number(const std::string& text, const std::filesystem::path& file) {
  double value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size())
    fail(ErrorKind::data, "{}: '{}' is no number", file.string(), text);
  return value;
}

}  // namespace ubs::accuracy
