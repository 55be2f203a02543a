// SPDX-License-Identifier: Apache-2.0
// JSON to and from text, for files of ours and of others.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace ubs {

// Members of objects keep the order in which they were written.
using Json = nlohmann::ordered_json;

// The library copies, compares and prints by recursion: a file of brackets alone would overflow the stack.
inline constexpr int kDeepestJson = 100;
// 200 000 frames with all that Nerfstudio writes about each are 200 MB.
inline constexpr std::size_t kLargestJson = std::size_t{512} << 20;

// Throws Error(data) that starts with `name` for what is no JSON, nested deeper, or larger, and Error(memory) for
// what does not fit into the memory that is left. Takes time proportional to the text.
Json parse_json(std::string_view text, const std::string& name);

// For files of ours, whose strings, names of members too, hold paths and other bytes (text.hpp). Never throws
// for what a string holds.
std::string json_text(const Json& json, int indent = -1);

// What json_text wrote; throws as parse_json.
Json parse_own_json(std::string_view text, const std::string& name);

}  // namespace ubs
