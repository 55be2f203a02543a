// SPDX-License-Identifier: Apache-2.0
// The published splat file (method.md 5.1): binary_little_endian, one element vertex, float32
// properties in the order of ParameterLayout, raw values. Reading finds properties by name, in any
// order and of any scalar type, ignores unknown ones and infers N from the scale_* properties. The form of
// the method (model_variant.hpp) is recorded in comment lines `ubs <key> <value>`, none for the published
// one. Models of several dimensions: the first group is the element vertex, so that other tools find splats
// they know; the others are elements vertex_<N>d behind it. A comment line `ubs groups 7,6,3` names them all,
// and makes readers that do not know groups refuse the file rather than draw a part of it.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

// `comments`, when given, receives the other comment lines of the header, without the word "comment ".
// An unknown switch or value, or properties that do not fit the switches, are an error, and so are groups.
SplatModel read_splat_ply(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr);

// Reads a model of one or several groups. `remarks`, when given, receives a sentence for each part of the
// file that the model does not use: properties of no known name, and further elements.
MixedModel read_mixed_ply(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr,
                          std::vector<std::string>* remarks = nullptr);

// Byte for byte what the published code writes, plus one comment line per entry of `comments`
// (official readers ignore them). A non-finite value is an error: nothing is written.
void write_splat_ply(const std::filesystem::path& path, const SplatModel& model,
                     std::span<const std::string> comments = {});
// With one group the same file as write_splat_ply.
void write_mixed_ply(const std::filesystem::path& path, const MixedModel& model,
                     std::span<const std::string> comments = {});

}  // namespace ubs
