// SPDX-License-Identifier: Apache-2.0
// These functions read and write the published splat file (method.md 5.1): binary_little_endian, one element
// vertex, float32 properties in the order of ParameterLayout, raw values. The reader finds properties by
// name, in any order and of any scalar type, ignores unknown ones and infers N from the scale_* properties.
// The variant of the method (model_variant.hpp) is recorded in comment lines `ubs <key> <value>`; the
// published variant has none.
// Models with splats of several dimensions have groups. The first group is the element vertex, so that other
// tools find splats that they can read; the other groups are elements vertex_<N>d after it. A comment line
// `ubs groups 7,6,3` lists all groups. Because of this line, ubs versions that do not support groups refuse
// the file instead of rendering a part of it.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/scene/mixed_model.hpp"

namespace ubs {

// Reads a model of one group. `comments`, if passed, receives the other comment lines of the header, without
// the word "comment ". Unknown keys or values, properties that do not fit the variant, and several groups are
// errors.
SplatModel read_splat_ply(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr);

// Reads a model of one or several groups. `remarks`, if passed, receives a sentence for each part of the file
// that the model does not use: unknown properties, and further elements.
MixedModel read_mixed_ply(const std::filesystem::path& path, std::vector<std::string>* comments = nullptr,
                          std::vector<std::string>* remarks = nullptr);

// Writes byte for byte the same file as the published code, plus one comment line per entry of `comments`
// (the published readers ignore them). If a value is not finite, throws and writes nothing.
void write_splat_ply(const std::filesystem::path& path, const SplatModel& model,
                     std::span<const std::string> comments = {});
// For a model with one group, writes the same file as write_splat_ply.
void write_mixed_ply(const std::filesystem::path& path, const MixedModel& model,
                     std::span<const std::string> comments = {});
// Returns the size of the file that write_mixed_ply() writes.
std::size_t mixed_ply_bytes(const MixedModel& model, std::span<const std::string> comments = {});

}  // namespace ubs
