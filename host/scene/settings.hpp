// SPDX-License-Identifier: Apache-2.0
// This file declares the functions that read and write settings as text, YAML and JSON, for any struct that
// has a table of fields. Every reader rejects unknown keys (and suggests the nearest known one), values out
// of range, and NaN.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/scene/field.hpp"

namespace ubs {

using FieldValues = std::span<const FieldValue>;

// Returns the value in the form that set_field() and the YAML reader accept: the shortest text that gives the
// same number, "auto" for kAuto, "r,g,b" for triples.
std::string field_text(const FieldValue& field);
// Returns "r,g,b", the 27 numbers of a sky, "learn", "sky" or "auto".
std::string to_string(const Background& background);
// Returns a description of the allowed values, for help texts and messages: "integer 1 to 8", "auto or number
// >= 0", "cpu|gpu".
std::string field_domain(const FieldValue& field);

// Parses integers in the forms that people and YAML tools write, which include "1e4", "30000.0", "7k", "300K"
// and "1.5M". Returns nothing for other texts.
std::optional<double> parse_whole(std::string_view text);

// Sets the field `key`. Throws Error(usage) with a message that starts with `origin` ("--set",
// "run.yaml:3:1").
void set_field(FieldValues fields, std::string_view key, std::string_view text, std::string_view origin);
// Sets a field from "key=value". Returns the key.
std::string set_field(FieldValues fields, std::string_view assignment, std::string_view origin);

// Reads a flat mapping of keys to values, with triples as [r, g, b] or "r,g,b". An empty file sets nothing.
// Returns the keys. Throws Error(data) with file:line:column if the file is unreadable or malformed, or a
// value is wrong.
std::vector<std::string> load_yaml(FieldValues fields, const std::filesystem::path& path);

// Returns all fields, with their help texts as comments. load_yaml() restores every value exactly from this
// text.
std::string to_yaml(FieldValues fields);
nlohmann::ordered_json to_json(FieldValues fields);

// Returns the number of characters that must be changed, added or removed to convert `a` into `b`.
std::size_t edit_distance(std::string_view a, std::string_view b);
// Returns the known word that is closest to `word` if `word` is likely to be a misspelling of it, and
// otherwise "".
std::string nearest_word(std::string_view word, std::span<const std::string> known);

}  // namespace ubs
