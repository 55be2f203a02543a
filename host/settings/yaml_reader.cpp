// SPDX-License-Identifier: Apache-2.0
#include "host/settings/yaml_reader.hpp"

#include <set>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/text.hpp"

namespace ubs {
namespace {

std::string locate(const std::filesystem::path& path, const YAML::Mark& mark) {
  if (mark.is_null()) return path.string();
  return fmt::format("{}:{}:{}", path.string(), mark.line + 1, mark.column + 1);
}

YAML::Node parse(const std::filesystem::path& path) {
  const std::string text = read_text_file(path);
  try {
    return YAML::Load(text);
  } catch (const YAML::Exception& error) {
    fail(ErrorKind::data, "{}: malformed YAML: {}", locate(path, error.mark), error.msg);
  }
}

}  // namespace

YamlReader::YamlReader(std::filesystem::path path) : path_(std::move(path)), root_(parse(path_)) {}

std::string YamlReader::where(const YAML::Node& node) const { return locate(path_, node.Mark()); }

std::vector<YamlEntry> YamlReader::entries(const YAML::Node& node, const std::string& what) const {
  std::vector<YamlEntry> found;
  if (!node.IsMap()) fail(ErrorKind::data, "{}: {} must be a mapping of keys to values", where(node), what);
  std::set<std::string> seen;
  for (const auto& entry : node) {
    const std::string at = where(entry.first);
    if (!entry.first.IsScalar()) fail(ErrorKind::data, "{}: a key must be a word", at);
    const std::string key = entry.first.Scalar();
    if (!seen.insert(key).second) fail(ErrorKind::data, "{}: key '{}' appears twice", at, key);
    found.push_back({key, at, entry.second});
  }
  return found;
}

std::string YamlReader::text(const YamlEntry& entry) const {
  if (entry.value.IsScalar()) return decode_text(entry.value.Scalar());
  const auto wrong = [&](const char* what) {
    fail(ErrorKind::data, "{}: {} must be a value, not {}", entry.where, entry.key, what);
  };
  if (entry.value.IsMap()) wrong("a mapping");
  if (!entry.value.IsSequence()) wrong("empty");
  std::string text;
  for (const YAML::Node& item : entry.value) {
    if (!item.IsScalar()) wrong("a nested list");
    text += (text.empty() ? "" : ",") + item.Scalar();
  }
  return text;
}

std::vector<std::string> YamlReader::set(FieldValues fields) const {
  std::vector<std::string> keys;
  if (root_.IsNull()) return keys;
  for (const YamlEntry& entry : entries(root_, "the file")) {
    try {
      set_field(fields, entry.key, text(entry), entry.where);
    } catch (const Error& error) {  // an error in a file is an Error(data)
      throw Error(ErrorKind::data, error.what());
    }
    keys.push_back(entry.key);
  }
  return keys;
}

}  // namespace ubs
