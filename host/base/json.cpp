// SPDX-License-Identifier: Apache-2.0
#include "host/base/json.hpp"

#include "host/base/error.hpp"
#include "host/base/text.hpp"

namespace ubs {
namespace {

Json with_strings(const Json& json, std::string (*convert)(std::string_view)) {
  if (json.is_string()) return convert(json.get_ref<const std::string&>());
  if (!json.is_structured()) return json;
  Json result = json.is_array() ? Json::array() : Json::object();
  if (json.is_array())
    for (const Json& item : json) result.push_back(with_strings(item, convert));
  else
    for (const auto& [key, value] : json.items()) result[convert(key)] = with_strings(value, convert);
  return result;
}

}  // namespace

Json parse_json(std::string_view text, const std::string& name) {
  try {
    return Json::parse(text.begin(), text.end(), [&](int depth, Json::parse_event_t, Json&) {
      if (depth > kDeepestJson) fail(ErrorKind::data, "{}: JSON nested deeper than {}", name, kDeepestJson);
      return true;
    });
  } catch (const Json::exception& error) {  // its message holds line and column
    fail(ErrorKind::data, "{}: malformed JSON: {}", name, error.what());
  }
}

std::string json_text(const Json& json, int indent) { return with_strings(json, encode_text).dump(indent); }

Json parse_own_json(std::string_view text, const std::string& name) {
  return with_strings(parse_json(text, name), decode_text);
}

}  // namespace ubs
