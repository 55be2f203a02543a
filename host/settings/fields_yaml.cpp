// SPDX-License-Identifier: Apache-2.0
// This file implements the YAML functions of settings.hpp. Reading uses YamlReader. Writing needs no library,
// because the file is a flat mapping.
#include <fmt/format.h>

#include "host/base/text.hpp"
#include "host/settings/fields.hpp"
#include "host/settings/yaml_reader.hpp"

namespace ubs {
namespace {

bool needs_quotes(const FieldValue& field, const std::string& text) {
  return (std::holds_alternative<std::string*>(field.value) ||
          std::holds_alternative<IndexRange*>(field.value) ||
          std::holds_alternative<ChoiceRef>(field.value)) &&
         (text.empty() || text.find_first_not_of("abcdefghijklmnopqrstuvwxyz_") != std::string::npos);
}

std::string single_quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("''") : std::string(1, c);
  return out + "'";
}

}  // namespace

std::vector<std::string> load_yaml(FieldValues fields, const std::filesystem::path& path) {
  return YamlReader(path).set(fields);
}

std::string to_yaml(FieldValues fields) {
  std::string out;
  for (const FieldValue& field : fields) {
    std::string text = encode_text(field_text(field));
    if (const auto* background = std::get_if<Background*>(&field.value);
        background && !(*background)->automatic && (*background)->learnt == Background::Learnt::no)
      text = "[" + text + "]";
    if (needs_quotes(field, text)) text = single_quoted(text);
    out += fmt::format("{}: {}  # {}\n", field.key, text, field.help);
  }
  return out;
}

}  // namespace ubs
