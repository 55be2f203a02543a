// SPDX-License-Identifier: Apache-2.0
// Reads and writes settings as text, YAML and JSON, for any struct that has a table of fields.
// Every reader refuses unknown keys (with the nearest known one), values out of range, and NaN.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/scene/field.hpp"

namespace ubs {

using FieldValues = std::span<const FieldValue>;

// The value as set_field and YAML read it: shortest form that gives back the same number, "auto" for
// kAuto, "r,g,b" for triples.
std::string field_text(const FieldValue& field);
// "r,g,b", the 27 numbers of a sky, or the word of what is to be learnt.
std::string to_string(const Background& background);
// What may be written, for help and messages: "integer 1 to 8", "auto or number >= 0", "cpu|gpu".
std::string field_domain(const FieldValue& field);

// `origin` starts the message ("--set", "run.yaml:3:1"). Throws Error(usage).
void set_field(FieldValues fields, std::string_view key, std::string_view text, std::string_view origin);
// "key=value"; returns the key.
std::string set_field(FieldValues fields, std::string_view assignment, std::string_view origin);

// A flat mapping of keys to values; triples as [r, g, b] or "r,g,b". An empty file sets nothing.
// Unreadable or malformed files and wrong values are Error(data) naming file:line:column. Returns the keys.
std::vector<std::string> load_yaml(FieldValues fields, const std::filesystem::path& path);

// All fields with their help as comments; load_yaml of it restores every value exactly.
std::string to_yaml(FieldValues fields);
nlohmann::ordered_json to_json(FieldValues fields);

// How many letters have to be changed, added or taken away.
std::size_t edit_distance(std::string_view a, std::string_view b);
// The known word closest to `word` when it is likely a misspelling, else "".
std::string nearest_word(std::string_view word, std::span<const std::string> known);

}  // namespace ubs
