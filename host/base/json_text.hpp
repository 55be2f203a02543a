// SPDX-License-Identifier: Apache-2.0
// JSON to and from text, for files of ours and of others. `Json` is nlohmann::json or nlohmann::ordered_json.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "host/base/error.hpp"
#include "host/base/text.hpp"

namespace ubs {

// The library copies, compares and prints by recursion: a file of brackets alone would overflow the stack.
inline constexpr int kDeepestJson = 100;

// Throws Error(data) that starts with `name` for what is no JSON, or nested deeper.
template <typename Json>
Json parse_json(std::string_view text, const std::string& name) {
  try {
    return Json::parse(text.begin(), text.end(), [&](int depth, typename Json::parse_event_t, Json&) {
      if (depth > kDeepestJson) fail(ErrorKind::data, "{}: JSON nested deeper than {}", name, kDeepestJson);
      return true;
    });
  } catch (const typename Json::exception& error) {  // its message holds line and column
    fail(ErrorKind::data, "{}: malformed JSON: {}", name, error.what());
  }
}

// With every string, names of members too, converted.
template <typename Json>
Json with_strings(const Json& json, std::string (*convert)(std::string_view)) {
  if (json.is_string()) return convert(json.template get_ref<const std::string&>());
  if (!json.is_structured()) return json;
  Json result = json.is_array() ? Json::array() : Json::object();
  if (json.is_array())
    for (const Json& item : json) result.push_back(with_strings(item, convert));
  else
    for (const auto& [key, value] : json.items()) result[convert(key)] = with_strings(value, convert);
  return result;
}

// For files of ours, whose strings hold paths and other bytes (text.hpp). Never throws for what a string
// holds.
template <typename Json>
std::string json_text(const Json& json, int indent = -1) {
  return with_strings(json, encode_text).dump(indent);
}

// What json_text wrote; throws as parse_json.
template <typename Json>
Json parse_own_json(std::string_view text, const std::string& name) {
  return with_strings(parse_json<Json>(text, name), decode_text);
}

}  // namespace ubs
