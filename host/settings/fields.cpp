// SPDX-License-Identifier: Apache-2.0
// This file implements the text and JSON functions of settings.hpp. The YAML functions are in
// settings_yaml.cpp.
#include "host/settings/fields.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/text.hpp"

namespace ubs {
namespace {

template <typename... Cases>
struct Overload : Cases... {
  using Cases::operator()...;
};
// Clang 14 does not deduce the template arguments of aggregates.
template <typename... Functions>
Overload(Functions...) -> Overload<Functions...>;

std::string_view trim(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// Returns the number if the whole text is a number, and otherwise nothing. std::from_chars is used because it
// does not depend on the locale.
template <typename Number>
std::optional<Number> parse(std::string_view text) {
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  Number value{};
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size()) return std::nullopt;
  return value;
}

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (std::size_t start = 0;;) {
    const std::size_t end = text.find(separator, start);
    parts.push_back(trim(text.substr(start, end - start)));
    if (end == std::string_view::npos) return parts;
    start = end + 1;
  }
}

std::string choice_text(const FieldValue& field, const ChoiceRef& choice) {
  return std::string(split(field.choices, '|').at(static_cast<std::size_t>(choice.get(choice.value))));
}

std::string range_text(const FieldValue& field) {
  const bool low = std::isfinite(field.min), high = std::isfinite(field.max);
  if (low && high) return fmt::format(" {} to {}", field.min, field.max);
  if (low) return fmt::format(" >= {}", field.min);
  if (high) return fmt::format(" <= {}", field.max);
  return "";
}

// Parses FIRST:END:STEP. If the field is automatic, but not decided by a rule, FIRST and FIRST:END are
// allowed too, and so is an empty text, which selects everything.
bool assign_range(const FieldValue& field, std::string_view text, IndexRange& to) {
  if (field.decided && text == "auto") {
    to = kAutoRange;
    return true;
  }
  IndexRange range;
  const auto parts = split(text, ':');
  const bool omits = field.automatic && !field.decided, all = omits && text.empty();
  if (!all && (parts.size() > 3 || (parts.size() < 3 && !omits))) return false;
  int* const numbers[] = {&range.first, &range.end, &range.step};
  for (std::size_t i = 0; !all && i < parts.size(); ++i) {
    const auto value = parse_whole(parts[i]);
    if (!value || !(*value >= field.min && *value <= field.max)) return false;
    *numbers[i] = static_cast<int>(*value);
  }
  if (range.first > range.end || range.step < 1) return false;
  to = range;
  return true;
}

std::string_view learnt_word(Background::Learnt learnt) {
  return learnt == Background::Learnt::colour ? "learn" : "sky";
}

// Parses "white", "black", "gray" or "grey" (0.5), "#rgb" and "#rrggbb" into numbers from 0 to 1.
std::optional<std::array<double, 3>> parse_colour(std::string_view text) {
  if (text == "white") return {{1, 1, 1}};
  if (text == "black") return {{0, 0, 0}};
  if (text == "gray" || text == "grey") return {{0.5, 0.5, 0.5}};
  if ((text.size() != 4 && text.size() != 7) || text[0] != '#') return std::nullopt;
  const std::size_t digits = (text.size() - 1) / 3;
  std::array<double, 3> colour{};
  for (std::size_t c = 0; c < 3; ++c) {
    unsigned value = 0;
    const char* const first = text.data() + 1 + c * digits;
    const auto result = std::from_chars(first, first + digits, value, 16);
    if (result.ec != std::errc() || result.ptr != first + digits) return std::nullopt;
    colour[c] = value / (digits == 1 ? 15.0 : 255.0);
  }
  return colour;
}

// Parses "auto", a colour, a colour with harmonics, "learn" or "sky".
bool assign_background(const FieldValue& field, std::string_view text, Background& to) {
  Background read;
  if (text == "auto") {
    to = {.automatic = true};
    return true;
  }
  if (const auto colour = parse_colour(text)) {
    to = {*colour};
    return true;
  }
  for (const auto learnt : {Background::Learnt::colour, Background::Learnt::sky})
    if (text == learnt_word(learnt)) read.learnt = learnt;
  const auto parts = split(text, ',');
  if (read.learnt == Background::Learnt::no && parts.size() != 3 && parts.size() != 3 + kSkyHarmonics)
    return false;
  for (std::size_t i = 0; read.learnt == Background::Learnt::no && i < parts.size(); ++i) {
    constexpr double kLargest = 1e6;  // larger than any value that training can reach
    const auto value = parse<double>(parts[i]);
    if (!value || !std::isfinite(*value)) return false;
    if (i < 3 ? *value < field.min || *value > field.max : std::abs(*value) > kLargest) return false;
    if (i < 3)
      read.colour[i] = *value;
    else
      read.harmonics.push_back(*value);
  }
  to = std::move(read);
  return true;
}

// Tries to store `text` in the field. Returns false if it is not an allowed value of the field.
bool assign(const FieldValue& field, std::string_view text) {
  const auto inside = [&](double v) { return std::isfinite(v) && v >= field.min && v <= field.max; };
  return std::visit(Overload{[&](int* to) {
                               if (field.automatic && text == "auto") {
                                 *to = kAutoInt;
                                 return true;
                               }
                               const auto value = parse_whole(text);
                               if (!value || !inside(*value) || std::abs(*value) > 2147483647.0) return false;
                               *to = static_cast<int>(*value);
                               return true;
                             },
                             [&](std::uint64_t* to) {
                               const auto value = parse<std::uint64_t>(text);  // exact for all 64-bit values
                               if (!value || !inside(static_cast<double>(*value))) return false;
                               *to = *value;
                               return true;
                             },
                             [&](double* to) {
                               if (field.automatic && text == "auto") {
                                 *to = kAuto;
                                 return true;
                               }
                               const auto value = parse<double>(text);
                               if (!value || !inside(*value)) return false;
                               *to = *value;
                               return true;
                             },
                             [&](bool* to) {
                               const bool yes =
                                   text == "true" || text == "1" || text == "on" || text == "yes";
                               if (!yes && text != "false" && text != "0" && text != "off" && text != "no")
                                 return false;
                               *to = yes;
                               return true;
                             },
                             [&](std::string* to) {
                               if (field.choices) {
                                 const auto choices = split(field.choices, '|');
                                 if (std::ranges::find(choices, text) == choices.end()) return false;
                               }
                               *to = text;
                               return true;
                             },
                             [&](Background* to) { return assign_background(field, text, *to); },
                             [&](IndexRange* to) { return assign_range(field, text, *to); },
                             [&](const ChoiceRef& to) {
                               const auto words = split(field.choices, '|');
                               const auto at = std::ranges::find(words, text);
                               if (at == words.end()) return false;
                               to.set(to.value, static_cast<int>(at - words.begin()));
                               return true;
                             }},
                    field.value);
}

[[noreturn]] void fail_unknown(FieldValues fields, std::string_view key, std::string_view origin) {
  std::vector<std::string> keys;
  for (const FieldValue& field : fields) keys.emplace_back(field.key);
  const std::string nearest = nearest_word(key, keys);
  fail(ErrorKind::usage, "{}: unknown key '{}'{}", origin, key,
       nearest.empty() ? "; `ubs train --help` lists the settings"
                       : fmt::format("; did you mean '{}'?", nearest));
}

}  // namespace

std::optional<double> parse_whole(std::string_view text) {
  const char last = text.empty() ? '\0' : text.back();
  const double unit = last == 'k' || last == 'K' ? 1e3 : last == 'M' ? 1e6 : 1;
  if (unit != 1) text.remove_suffix(1);
  auto value = parse<double>(text);
  if (value) *value *= unit;
  if (!value || !(std::abs(*value) <= 9007199254740992.0) || *value != std::floor(*value))
    return std::nullopt;
  return value;
}

std::string to_string(const Background& background) {
  if (background.learnt != Background::Learnt::no) return std::string(learnt_word(background.learnt));
  if (background.automatic) return "auto";
  std::string text = fmt::format("{}", fmt::join(background.colour, ","));
  for (const double number : background.harmonics) text += fmt::format(",{}", number);
  return text;
}

bool is_automatic(const FieldValue& field) {
  return std::visit(
      Overload{[&](const int* v) { return field.automatic && *v == kAutoInt; },
               [](const double* v) { return *v == kAuto; }, [](const std::string* v) { return *v == "auto"; },
               [](const Background* v) { return v->automatic && v->learnt == Background::Learnt::no; },
               [&](const IndexRange* v) { return field.decided && *v == kAutoRange; },
               [&](const ChoiceRef& v) { return choice_text(field, v) == "auto"; },
               [](const auto*) { return false; }},
      field.value);
}

std::string field_text(const FieldValue& field) {
  if (is_automatic(field)) return "auto";
  return std::visit(
      Overload{[](const int* v) { return fmt::format("{}", *v); },
               [](const std::uint64_t* v) { return fmt::format("{}", *v); },
               [](const double* v) { return fmt::format("{}", *v); },
               [](const bool* v) { return std::string(*v ? "true" : "false"); },
               [](const std::string* v) { return *v; }, [](const Background* v) { return to_string(*v); },
               [](const IndexRange* v) { return to_string(*v); },
               [&](const ChoiceRef& v) { return choice_text(field, v); }},
      field.value);
}

std::string field_domain(const FieldValue& field) {
  const std::string range = range_text(field);
  return std::visit(
      Overload{[&](int*) { return (field.automatic ? "auto or integer" : "integer") + range; },
               [&](std::uint64_t*) { return std::string("integer >= 0"); },
               [&](double*) { return (field.automatic ? "auto or number" : "number") + range; },
               [&](bool*) { return std::string("true or false"); },
               [&](std::string*) { return std::string(field.choices ? field.choices : "text"); },
               [&](Background*) {
                 return "auto, three numbers r,g,b" + range +
                        ", white, black, gray, #rrggbb, the 27 coefficients of a learnt sky, learn, or sky";
               },
               [&](IndexRange*) {
                 return fmt::format("FIRST:END:STEP{}{}", range,
                                    field.decided     ? ", or auto"
                                    : field.automatic ? ", or an empty text for all"
                                                      : "");
               },
               [&](const ChoiceRef&) { return std::string(field.choices); }},
      field.value);
}

void set_field(FieldValues fields, std::string_view key, std::string_view text, std::string_view origin) {
  const auto field = std::ranges::find_if(fields, [&](const FieldValue& f) { return f.key == key; });
  if (field == fields.end()) fail_unknown(fields, key, origin);
  if (!assign(*field, trim(text)))
    fail(ErrorKind::usage, "{}: {} = '{}' is not allowed: expected {}", origin, key, text,
         field_domain(*field));
}

std::string set_field(FieldValues fields, std::string_view assignment, std::string_view origin) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string_view::npos)
    fail(ErrorKind::usage, "{}: '{}' is not of the form key=value", origin, assignment);
  const std::string_view key = trim(assignment.substr(0, equals));
  set_field(fields, key, assignment.substr(equals + 1), origin);
  return std::string(key);
}

std::string set_field_from_run(FieldValues fields, std::string_view key, std::string_view text,
                               std::string_view origin) {
  const auto field = std::ranges::find_if(fields, [&](const FieldValue& f) { return f.key == key; });
  const std::string before = field == fields.end() ? "" : field_text(*field);
  set_field(fields, key, text, origin);
  std::string in_file = field_text(*field);
  if (field->uses & kOfUser) assign(*field, before);
  return in_file;
}

nlohmann::ordered_json to_json(FieldValues fields) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  for (const FieldValue& field : fields) {
    if (is_automatic(field)) {
      json[field.key] = "auto";
      continue;
    }
    std::visit(Overload{[&](const IndexRange* v) { json[field.key] = to_string(*v); },
                        [&](const ChoiceRef& v) { json[field.key] = choice_text(field, v); },
                        [&](const Background* v) {
                          if (*v == Background{v->colour})
                            json[field.key] = v->colour;
                          else
                            json[field.key] = to_string(*v);
                        },
                        [&](const auto* v) { json[field.key] = *v; }},
               field.value);
  }
  return json;
}

}  // namespace ubs
