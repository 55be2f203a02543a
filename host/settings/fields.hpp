// SPDX-License-Identifier: Apache-2.0
// This file declares the functions that read and write settings as text, YAML and JSON, for any struct that
// has a table of fields. Every reader rejects unknown keys, values out of range, and NaN. For an unknown key,
// the message suggests the most similar known key.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/settings/field.hpp"

namespace ubs {

using FieldValues = std::span<const FieldValue>;

// Returns the value as a string that set_field() and the YAML reader accept. Numbers have the fewest digits
// that give the same number again. Automatic values are "auto", and colours are "r,g,b".
std::string field_text(const FieldValue& field);
// Returns whether the value of the field is automatic.
bool is_automatic(const FieldValue& field);
// Returns "r,g,b", "learn", "sky", "auto", or the 27 coefficients of a learnt sky (method.md 4.11).
std::string to_string(const Background& background);
// Returns a description of the allowed values, for help texts and messages: "integer 1 to 8", "auto or number
// >= 0", "cpu|gpu".
std::string field_domain(const FieldValue& field);

// Parses an integer. Texts such as "1e4", "30000.0", "7k", "300K" and "1.5M", which users and YAML tools
// write, are allowed too. Returns nothing if the text is not an integer.
std::optional<double> parse_whole(std::string_view text);

// Sets the field `key` to the value that `text` contains. `origin` is the source of the value, such as
// "--set" or "run.yaml:3:1". If the key is unknown or the value is not allowed, throws Error(usage) with a
// message that starts with `origin`.
void set_field(FieldValues fields, std::string_view key, std::string_view text, std::string_view origin);
// Sets a field from a string "key=value", and returns the key.
std::string set_field(FieldValues fields, std::string_view assignment, std::string_view origin);

// Sets a field to a value from a file of a run (config.yaml, metrics.json, a checkpoint). Such files may come
// from anyone. Therefore a field with kOfUser keeps its value, although the text is checked in the same way.
// Returns the value in the file, as field_text() writes it. Throws the same errors as set_field().
std::string set_field_from_run(FieldValues fields, std::string_view key, std::string_view text,
                               std::string_view origin);

// Reads a YAML file with a flat mapping of keys to values, sets these fields, and returns the keys. Lists of
// numbers, such as colours, can be written as [r, g, b] or "r,g,b". An empty file sets nothing. Throws
// Error(data) if the file cannot be read, is malformed, or contains an unknown key or a value that is not
// allowed. The message contains file, line and column.
std::vector<std::string> load_yaml(FieldValues fields, const std::filesystem::path& path);

// to_yaml() returns all fields as YAML, with their help texts as comments. load_yaml() restores every value
// exactly from this text. to_json() returns all fields as a JSON object.
std::string to_yaml(FieldValues fields);
nlohmann::ordered_json to_json(FieldValues fields);

}  // namespace ubs
