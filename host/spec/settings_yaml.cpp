// SPDX-License-Identifier: Apache-2.0
// YAML side of settings.hpp (yaml-cpp reads; writing a flat mapping needs no library).
#include <yaml-cpp/yaml.h>

#include <set>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/spec/settings.hpp"

namespace ubs {
namespace {

std::string locate(const std::filesystem::path& path, const YAML::Mark& mark) {
  if (mark.is_null()) return path.string();
  return fmt::format("{}:{}:{}", path.string(), mark.line + 1, mark.column + 1);
}

// Scalars as they stand in the file; a sequence of scalars as "a,b,c".
std::string value_text(const YAML::Node& value, const std::string& key, const std::string& where) {
  if (value.IsScalar()) return value.Scalar();
  const auto wrong = [&](const char* what) {
    fail(ErrorKind::data, "{}: {} must be a value, not {}", where, key, what);
  };
  if (value.IsMap()) wrong("a mapping");
  if (!value.IsSequence()) wrong("empty");
  std::string text;
  for (const YAML::Node& item : value) {
    if (!item.IsScalar()) wrong("a nested list");
    text += (text.empty() ? "" : ",") + item.Scalar();
  }
  return text;
}

YAML::Node parse_yaml(const std::filesystem::path& path) {
  const std::string text = read_text_file(path);
  try {
    return YAML::Load(text);
  } catch (const YAML::Exception& error) {
    fail(ErrorKind::data, "{}: malformed YAML: {}", locate(path, error.mark), error.msg);
  }
}

bool needs_quotes(const FieldValue& field, const std::string& text) {
  return std::holds_alternative<std::string*>(field.value) &&
         (text.empty() || text.find_first_not_of("abcdefghijklmnopqrstuvwxyz_") != std::string::npos);
}

std::string single_quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("''") : std::string(1, c);
  return out + "'";
}

}  // namespace

void load_yaml(FieldValues fields, const std::filesystem::path& path) {
  const YAML::Node root = parse_yaml(path);
  if (root.IsNull()) return;
  if (!root.IsMap())
    fail(ErrorKind::data, "{}: the file must be a mapping of keys to values", locate(path, root.Mark()));
  std::set<std::string> seen;
  for (const auto& entry : root) {
    const std::string where = locate(path, entry.first.Mark());
    if (!entry.first.IsScalar()) fail(ErrorKind::data, "{}: a key must be a word", where);
    const std::string key = entry.first.Scalar();
    if (!seen.insert(key).second) fail(ErrorKind::data, "{}: key '{}' appears twice", where, key);
    const std::string text = value_text(entry.second, key, where);
    try {
      set_field(fields, key, text, where);
    } catch (const Error& error) {  // the same complaint, but about a file
      throw Error(ErrorKind::data, error.what());
    }
  }
}

std::string to_yaml(FieldValues fields) {
  std::string out;
  for (const FieldValue& field : fields) {
    std::string text = field_text(field);
    if (std::holds_alternative<std::array<double, 3>*>(field.value)) text = "[" + text + "]";
    if (needs_quotes(field, text)) text = single_quoted(text);
    out += fmt::format("{}: {}  # {}\n", field.key, text, field.help);
  }
  return out;
}

}  // namespace ubs
