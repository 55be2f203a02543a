// SPDX-License-Identifier: Apache-2.0
#include "host/base/json.hpp"

#include <algorithm>
#include <map>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/base/text.hpp"

namespace ubs {
namespace {

using Convert = std::string (*)(std::string_view);

// Estimated memory per value [bytes]. A value in an array takes 16 bytes, and a member of an object takes 48
// bytes and its name. While a vector grows, it takes twice this memory, and while an object is read, a map of
// its names is needed too.
constexpr std::uint64_t kBytesAValue = 256;
// The available memory is only checked if parsing needs more than this [bytes].
constexpr std::uint64_t kSmallJson = 16 << 20;
constexpr std::size_t kMaxMembers = 1000;  // for limit_members(); files of known programs have less than 50

// JsonBuilder builds the values that Json::sax_parse reads, in time proportional to the length of the text.
// The builder of the library nlohmann/json is slower: for each new member it searches all members of the
// object, and with a callback it also searches all members of the parent whenever a nested value ends. If
// several members have the same name, JsonBuilder uses the last value, at the position of the first.
class JsonBuilder : public nlohmann::json_sax<Json> {
 public:
  JsonBuilder(std::string_view text, const std::string& name, Convert convert)
      : text_(text), name_(name), convert_(convert) {}

  Json take() { return std::move(root_); }

  bool null() override { return put(nullptr); }
  bool boolean(bool value) override { return put(value); }
  bool number_integer(number_integer_t value) override { return put(value); }
  bool number_unsigned(number_unsigned_t value) override { return put(value); }
  bool number_float(number_float_t value, const string_t&) override { return put(value); }
  bool string(string_t& value) override { return put(convert_ ? convert_(value) : std::move(value)); }
  bool binary(binary_t&) override { return false; }  // JSON text contains no binary values

  bool start_object(std::size_t) override { return open(false); }
  bool start_array(std::size_t) override { return open(true); }
  bool key(string_t& value) override {
    open_.back().key = convert_ ? convert_(value) : std::move(value);
    return true;
  }
  bool end_object() override {
    auto& members = open_.back().members;
    Json object = Json::object();
    auto& to = object.get_ref<Json::object_t&>();
    to.reserve(members.size());  // because growing would copy all nested values
    for (auto& [key, value] : members) to.emplace_back(std::move(key), std::move(value));
    return close(std::move(object));
  }
  bool end_array() override { return close(std::move(open_.back().items)); }
  bool parse_error(std::size_t position, const std::string& token,
                   const nlohmann::detail::exception& error) override {
    // The parser stops after the first character of "//", "/*" or "#".
    const std::string_view read = text_.substr(0, position);
    const std::string_view next = text_.substr(read.size(), 1);
    if (token.ends_with('#') || (token.ends_with('/') && (next == "/" || next == "*")))
      fail(ErrorKind::data,
           "{}: the file contains comments, which JSON does not allow: remove them (line {})", name_,
           1 + std::ranges::count(read, '\n'));
    fail(ErrorKind::data, "{}: malformed JSON: {}", name_, error.what());  // what() contains line and column
  }

 private:
  struct Open {
    bool is_array;
    Json::array_t items;
    std::vector<std::pair<std::string, Json>> members;
    std::map<std::string, std::size_t> places;  // indices of the members
    std::string key;
  };

  bool open(bool is_array) {
    if (open_.size() == kDeepestJson)
      fail(ErrorKind::data, "{}: the JSON is nested deeper than {} levels", name_, kDeepestJson);
    open_.push_back({is_array, {}, {}, {}, {}});
    return true;
  }
  bool close(Json value) {
    open_.pop_back();
    return put(std::move(value));
  }
  bool put(Json value) {
    if (open_.empty()) {
      root_ = std::move(value);
    } else if (Open& to = open_.back(); to.is_array) {
      to.items.push_back(std::move(value));
    } else {
      const auto [place, is_new] = to.places.try_emplace(to.key, to.members.size());
      if (is_new)
        to.members.emplace_back(std::move(to.key), std::move(value));
      else
        to.members[place->second].second = std::move(value);
    }
    return true;
  }

  std::string_view text_;
  const std::string& name_;
  Convert convert_;
  Json root_;
  std::vector<Open> open_;
};

// Throws an error if a text is too long, or if parsing it may need more memory than is available. This must
// be checked before parsing, because the library nlohmann/json needs memory even to destroy a value. The
// number of values is estimated as the number of the characters ',', '[' and '{', because every value except
// the outermost one follows one of them.
void check_size(std::string_view text, const std::string& name) {
  if (text.size() > kLargestJson)
    fail(ErrorKind::data, "{}: the JSON has {} bytes, but at most {} are supported", name, text.size(),
         kLargestJson);
  const auto values = std::ranges::count_if(text, [](char c) { return c == ',' || c == '[' || c == '{'; });
  const std::uint64_t need = kBytesAValue * static_cast<std::uint64_t>(values) + 2 * text.size();
  if (need > kSmallJson) require_memory(need, fmt::format("{}: JSON of {} bytes", name, text.size()));
}

// Throws an error if the text is in UTF-16, which PowerShell and the editor of Windows write.
void check_encoding(std::string_view text, const std::string& name) {
  const std::string_view start = text.substr(0, 2);
  if (start == "\xff\xfe" || start == "\xfe\xff" ||
      (start.size() == 2 && (start[0] == '\0') != (start[1] == '\0')))
    fail(ErrorKind::data, "{}: the text is in UTF-16: save it as UTF-8", name);
}

Json parse(std::string_view text, const std::string& name, Convert convert) {
  check_encoding(text, name);
  check_size(text, name);
  JsonBuilder builder(text, name, convert);
  Json::sax_parse(text.begin(), text.end(), &builder);
  return builder.take();
}

Json with_encoded_strings(const Json& json) {
  if (json.is_string()) return encode_text(json.get_ref<const std::string&>());
  if (!json.is_structured()) return json;
  Json result = json.is_array() ? Json::array() : Json::object();
  if (json.is_array()) {
    for (const Json& item : json) result.push_back(with_encoded_strings(item));
  } else {  // encode_text() gives different texts for different names, so there are no duplicates
    auto& members = result.get_ref<Json::object_t&>();
    members.reserve(json.size());
    for (const auto& [key, value] : json.items())
      members.emplace_back(encode_text(key), with_encoded_strings(value));
  }
  return result;
}

}  // namespace

Json parse_json(std::string_view text, const std::string& name) { return parse(text, name, nullptr); }

void limit_members(const Json& json, const std::string& name) {
  if (json.is_object() && json.size() > kMaxMembers)
    fail(ErrorKind::data, "{}: the top level of the JSON has {} members, but at most {} are supported", name,
         json.size(), kMaxMembers);
}

std::string json_text(const Json& json, int indent) { return with_encoded_strings(json).dump(indent); }

Json parse_own_json(std::string_view text, const std::string& name) { return parse(text, name, decode_text); }

}  // namespace ubs
