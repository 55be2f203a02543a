// SPDX-License-Identifier: Apache-2.0
// These functions convert JSON to and from text. They are used for files of ubs and of other programs.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace ubs {

// Members of objects keep the order in which they were written.
using Json = nlohmann::ordered_json;

// Maximum nesting depth. The library nlohmann/json copies, compares and prints values recursively, so values
// that are nested more deeply could overflow the stack.
inline constexpr int kDeepestJson = 100;
// Maximum size of a text [bytes]. For comparison, a file with 200 000 frames and all fields that Nerfstudio
// writes has 200 MB.
inline constexpr std::size_t kLargestJson = std::size_t{512} << 20;

// Parses text in time proportional to its length. Throws Error(data) if the text is not JSON, or exceeds the
// maximum depth or size. Throws Error(memory) if it would not fit into the available memory. The messages
// start with `name`.
Json parse_json(std::string_view text, const std::string& name);

// Throws Error(data) if the value is an object with more members than the files of any known program have.
// Looking up a name takes a time proportional to the number of members. A reader that looks up members of the
// same object again for each of many other values calls this function first, so that its time remains
// proportional to the length of the file.
void limit_members(const Json& json, const std::string& name);

// Returns JSON as text for files of ubs. Strings and names of members may contain arbitrary bytes, for
// example paths, because they are encoded with encode_text() (text.hpp). So no contents of a string cause an
// exception.
std::string json_text(const Json& json, int indent = -1);

// Parses a text that json_text() has written, and decodes its strings. Throws the same errors as
// parse_json().
Json parse_own_json(std::string_view text, const std::string& name);

}  // namespace ubs
