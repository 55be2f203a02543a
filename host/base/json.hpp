// SPDX-License-Identifier: Apache-2.0
// Converts JSON to and from text, for files of ubs and of other programs.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace ubs {

// Members of objects keep the order in which they were written.
using Json = nlohmann::ordered_json;

// Maximum nesting depth. The library copies, compares and prints recursively, so that deep nesting would
// overflow the stack.
inline constexpr int kDeepestJson = 100;
// Maximum size. 200 000 frames with everything that Nerfstudio writes for each of them take 200 MB.
inline constexpr std::size_t kLargestJson = std::size_t{512} << 20;

// Parses text in time proportional to its length. Throws Error(data) if the text is not JSON, or exceeds the
// maximum depth or size. Throws Error(memory) if it would not fit into the available memory. The messages
// start with `name`.
Json parse_json(std::string_view text, const std::string& name);

// Returns the text of JSON in files of ubs. Strings and names of members may contain paths and any other
// bytes (text.hpp). Never throws because of the contents of a string.
std::string json_text(const Json& json, int indent = -1);

// Parses the output of json_text(). Throws like parse_json().
Json parse_own_json(std::string_view text, const std::string& name);

}  // namespace ubs
